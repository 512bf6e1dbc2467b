from services.geometry.memory_budget import MemoryBudget


class Heap:
    """Holds bytes in pieces of one size."""

    def __init__(self, budget: MemoryBudget, piece: int) -> None:
        self._budget = budget
        self._piece = piece
        self.pieces = 0

    def add(self, count: int) -> None:
        self.pieces += count
        self._budget.hold(self, self.pieces * self._piece)
        self._budget.settle()

    def shed(self) -> None:
        self.add(-1)


def test_nobody_gives_way_while_there_is_room() -> None:
    budget = MemoryBudget(100)
    few, many = Heap(budget, 10), Heap(budget, 10)
    few.add(2)
    many.add(8)
    assert (few.pieces, many.pieces, budget.taken) == (2, 8, 100)


def test_who_holds_most_gives_way_whoever_came_last() -> None:
    budget = MemoryBudget(100)
    few, many = Heap(budget, 10), Heap(budget, 10)
    many.add(10)
    few.add(3)
    assert (few.pieces, many.pieces, budget.taken) == (3, 7, 100)
    few.add(9)
    assert (few.pieces, many.pieces) == (5, 5)


def test_what_does_not_fit_at_all_leaves_at_once() -> None:
    budget = MemoryBudget(100)
    large = Heap(budget, 101)
    large.add(1)
    assert (large.pieces, budget.taken) == (0, 0)
