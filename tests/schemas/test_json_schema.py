import re
from pathlib import Path

import msgspec

from schemas.codec import MAX_BYTES, encoding
from schemas.json_schema import as_text, json_schema

FILE = Path(__file__).parents[2] / "docs" / "messages.schema.json"


def test_the_file_in_the_documentation_is_current() -> None:
    assert FILE.read_text(encoding="utf-8") == as_text(), "python -m schemas.json_schema > docs/messages.schema.json"


def test_every_message_is_in_it_with_its_encoding() -> None:
    defined = json_schema()["$defs"]
    assert {schema.__name__: encoding(schema) for schema in MAX_BYTES} == {
        name: part["zenohEncoding"] for name, part in defined.items() if "zenohEncoding" in part
    }


def test_all_that_it_refers_to_is_in_it() -> None:
    names = set(re.findall(r'"#/\$defs/(\w+)"', as_text()))
    assert {"Header", "Box", "Mask"} <= names
    assert names <= json_schema()["$defs"].keys()


def test_bounds_are_those_that_are_checked() -> None:
    box = msgspec.json.decode(FILE.read_bytes())["$defs"]["Detection"]
    assert box["properties"]["score"] == {"type": "number", "minimum": 0, "maximum": 1}
    assert box["required"] == ["name", "score", "box"]
