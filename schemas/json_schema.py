"""The messages as one JSON Schema, for programs in other languages; `python -m schemas.json_schema` prints it."""

import sys
from inspect import cleandoc
from typing import Any, Final

import msgspec

from schemas.codec import MAX_BYTES, encoding

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"

COMMENT: Final = (
    "Payloads are MessagePack maps of this form; where a string's contentEncoding is base64, MessagePack has bin. "
    "zenohEncoding is what Zenoh says a payload is. Fields that are not known are to be ignored."
)


def json_schema() -> dict[str, Any]:
    """Return a schema whose `$defs` are the messages and their parts, by name."""
    messages = {schema.__name__: schema for schema in MAX_BYTES}
    _, parts = msgspec.json.schema_components(list(messages.values()), ref_template="#/$defs/{name}")
    named = {name: part | _about(name, part, messages) for name, part in sorted(parts.items())}
    return {"$schema": DIALECT, "title": "fleetsight", "$comment": COMMENT, "$defs": named}


def _about(name: str, part: dict[str, Any], messages: dict[str, type]) -> dict[str, str]:
    text, _, _ = cleandoc(part.get("description", "")).partition("\n\n>>> ")  # examples are in Python
    about = {"description": text} if text else {}
    return about | ({"zenohEncoding": encoding(messages[name])} if name in messages else {})


def as_text() -> str:
    """Return the schema as JSON text; the output is deterministic."""
    return msgspec.json.format(msgspec.json.encode(json_schema()), indent=2).decode() + "\n"


if __name__ == "__main__":
    sys.stdout.write(as_text())
