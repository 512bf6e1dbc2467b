import pytest

from bus.api import MAX_TIMEOUT_S
from bus.requests.queries import DEFAULT_TIMEOUT_S, timeout_of


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1500", 1.5),
        ("0", 0.0),
        ("60000", 60.0),
        ("60001", MAX_TIMEOUT_S),
        ("999999999", MAX_TIMEOUT_S),
        ("9999999999", DEFAULT_TIMEOUT_S),
        ("-1", DEFAULT_TIMEOUT_S),
        ("1.5", DEFAULT_TIMEOUT_S),
        ("²", DEFAULT_TIMEOUT_S),
        ("", DEFAULT_TIMEOUT_S),
        (None, DEFAULT_TIMEOUT_S),
    ],
)
def test_how_long_a_querys_sender_waits(text: str | None, seconds: float) -> None:
    assert timeout_of(text) == seconds
