from services.geometry.room import Room


class Heap:
    """Holds bytes in pieces of one size."""

    def __init__(self, room: Room, piece: int) -> None:
        self._room = room
        self._piece = piece
        self.pieces = 0

    def add(self, count: int) -> None:
        self.pieces += count
        self._room.hold(self, self.pieces * self._piece)
        self._room.settle()

    def shed(self) -> None:
        self.add(-1)


def test_nobody_gives_way_while_there_is_room() -> None:
    room = Room(100)
    few, many = Heap(room, 10), Heap(room, 10)
    few.add(2)
    many.add(8)
    assert (few.pieces, many.pieces, room.taken) == (2, 8, 100)


def test_who_holds_most_gives_way_whoever_came_last() -> None:
    room = Room(100)
    few, many = Heap(room, 10), Heap(room, 10)
    many.add(10)
    few.add(3)
    assert (few.pieces, many.pieces, room.taken) == (3, 7, 100)
    few.add(9)
    assert (few.pieces, many.pieces) == (5, 5)


def test_what_does_not_fit_at_all_leaves_at_once() -> None:
    room = Room(100)
    large = Heap(room, 101)
    large.add(1)
    assert (large.pieces, room.taken) == (0, 0)
