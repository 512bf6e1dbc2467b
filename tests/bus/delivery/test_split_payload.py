from collections.abc import Callable

import pytest

from bus.delivery.split_payload import Pieces, joined
from tests.bus.rooms import Room

BODY = bytes(range(100, 150))
HEAD = b"a head"
TAIL = b"tail"
WHOLE = HEAD + BODY + TAIL


def message(before: int, after: int) -> tuple[bytearray, memoryview]:
    """Return a message with a body in it, and that body."""
    whole = bytearray(b"<" * before + BODY + b">" * after)
    return whole, memoryview(whole)[before : before + len(BODY)]


@pytest.mark.parametrize(
    ("before", "after"), [(before, after) for before in (0, 1, len(HEAD)) for after in (0, 1, len(TAIL))]
)
def test_what_fits_between_the_ends_is_written_as_it_is(before: int, after: int) -> None:
    whole, body = message(before, after)
    room = Room(len(WHOLE))
    Pieces(HEAD, body, TAIL).write(room)
    assert room.memory == WHOLE
    assert room.written[0] is whole


def too_much_before() -> memoryview:
    return message(len(HEAD) + 1, 0)[1]


def too_much_after() -> memoryview:
    return message(0, len(TAIL) + 1)[1]


def of_bytes() -> memoryview:
    return memoryview(BODY)


def not_to_be_written() -> memoryview:
    return message(0, 0)[1].toreadonly()


@pytest.mark.parametrize("body", [too_much_before, too_much_after, of_bytes, not_to_be_written])
def test_what_does_not_is_joined_before(body: Callable[[], memoryview]) -> None:
    room = Room(len(WHOLE))
    Pieces(HEAD, body(), TAIL).write(room)
    assert room.memory == WHOLE
    assert room.written == [WHOLE]


def test_a_room_may_be_larger_and_a_tail_missing() -> None:
    _, body = message(2, 0)
    room = Room(len(WHOLE) + 10)
    Pieces(HEAD, body).write(room)
    assert room.memory == (HEAD + BODY).ljust(len(room.memory), b"\0")


def test_a_body_may_be_empty() -> None:
    room = Room(len(HEAD))
    Pieces(HEAD, memoryview(bytearray())).write(room)
    assert room.memory == HEAD


def test_a_view_of_wider_items_is_its_bytes() -> None:
    numbers = memoryview(bytearray(BODY)).cast("H")
    room = Room(len(WHOLE))
    pieces = Pieces(HEAD, numbers, TAIL)
    assert len(pieces) == len(WHOLE)
    pieces.write(room)
    assert room.memory == WHOLE


def test_joined_they_are_one_piece_and_so_is_what_was_one() -> None:
    assert joined(Pieces(HEAD, memoryview(BODY), TAIL)) == WHOLE
    payload = bytearray(WHOLE)
    assert joined(payload) is payload
