from typing import Any

import msgspec
import pytest

from schemas import codec
from schemas.alerts import MAX_PAYLOAD, MAX_TEXT, Action, Alert
from schemas.errors import SchemaError
from tests.schemas.results import action, alert


def sent(message: Alert | Action, **fields: Any) -> Alert | Action:
    """Send a message with other fields over the wire."""
    payload = msgspec.msgpack.encode({**msgspec.to_builtins(message), **fields})
    return codec.decode(type(message), payload, codec.encoding(type(message)))


@pytest.mark.parametrize(
    ("message", "field", "wrong"),
    [
        (alert(), "id", ""),
        (alert(), "id", "a" * 65),
        (alert(), "severity", "panic"),
        (alert(), "state", "forgotten"),
        (alert(), "robot", "a/b"),
        (alert(), "camera", "a/b"),
        (alert(), "text", "a" * (MAX_TEXT + 1)),
        (alert(), "changed_ns", -1),
        (action(), "id", ""),
        (action(), "name", "pick up"),
        (action(), "payload", "a" * (MAX_PAYLOAD + 1)),
    ],
)
def test_what_is_out_of_bounds_is_refused(message: Alert | Action, field: str, wrong: object) -> None:
    with pytest.raises(SchemaError, match=field):
        sent(message, **{field: wrong})


def test_the_longest_texts_are_carried() -> None:
    for message, fields in (
        (alert(), {"text": "箱" * MAX_TEXT, "camera": ""}),
        (action(), {"payload": "箱" * MAX_PAYLOAD}),
    ):
        read = sent(message, id="a" * 64, **fields)
        assert all(getattr(read, name) == value for name, value in fields.items())
