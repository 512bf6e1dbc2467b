from collections import defaultdict

from hypothesis import given
from hypothesis import strategies as st

from bus.delivery.mailbox import OWNER_BYTES, Fifo, InTurn, PerKey, Taken

KEYS = "abcd"
# None takes, a key offers the next number under that key.
steps = st.lists(st.one_of(st.none(), st.sampled_from(KEYS)), max_size=60)


def test_per_key_keeps_the_newest_of_each_key() -> None:
    box: PerKey[str, int] = PerKey()
    assert [box.offer("a", 1), box.offer("b", 2), box.offer("a", 3), box.offer("a", 4)] == [0, 0, 1, 1]
    assert box.take() == Taken("a", 4, 2)
    assert box.take() == Taken("b", 2, 0)
    assert box.take() is None


def test_per_key_serves_first_the_key_served_longest_ago() -> None:
    box: PerKey[str, int] = PerKey()
    for key in "abc":
        box.offer(key, 0)
    assert [taken.key for taken in (box.take(), box.take(), box.take()) if taken] == ["a", "b", "c"]
    for key in "cba":
        box.offer(key, 1)
    box.offer("new", 1)
    assert [taken.key for taken in (box.take(), box.take(), box.take(), box.take()) if taken] == ["new", "a", "b", "c"]


def test_per_key_has_room_for_so_many_keys() -> None:
    box: PerKey[int, int] = PerKey(max_keys=2)
    assert [box.offer(1, 1), box.offer(2, 2), box.offer(3, 3)] == [0, 0, 1]
    assert box.take() == Taken(1, 1, 0)
    assert box.offer(3, 3) == 0
    assert [box.take(), box.take()] == [Taken(2, 2, 0), Taken(3, 3, 0)]


def test_per_key_has_room_for_so_many_bytes_and_always_for_one_item() -> None:
    box: PerKey[str, int] = PerKey(most_bytes=10, size=lambda item: item)
    assert [box.offer("a", 6), box.offer("b", 4), box.offer("c", 1), box.offer("b", 5)] == [0, 0, 1, 1]
    assert [box.offer("a", 5), box.offer("b", 5)] == [1, 1]
    assert [box.take(), box.take(), box.take()] == [Taken("a", 5, 1), Taken("b", 5, 2), None]
    assert [box.offer("c", 99), box.offer("c", 98), box.offer("a", 1)] == [0, 1, 1]
    assert box.discard("c") == [98]
    assert [box.offer("a", 10), box.take()] == [0, Taken("a", 10, 0)]


def test_per_key_forgets_a_discarded_key() -> None:
    box: PerKey[str, int] = PerKey(depth=3)
    for number in range(3):
        box.offer("a", number)
    box.offer("b", 9)
    assert "a" in box
    assert box.discard("a") == [0, 1, 2]
    assert "a" not in box
    assert box.discard("a") == []
    assert box.take() == Taken("b", 9, 0)
    assert box.take() is None


def test_per_key_lets_fewer_wait_with_an_item_that_says_so() -> None:
    box: PerKey[str, int] = PerKey()
    assert [box.offer("a", number, depth=3) for number in range(4)] == [0, 0, 0, 1]
    assert box.offer("a", 4) == 3
    assert [box.offer("a", number, depth=3) for number in (5, 6, 7)] == [0, 0, 1]
    assert box.take() == Taken("a", 5, 5)


@given(steps, st.integers(1, 3))
def test_per_key_against_a_model(steps: list[str | None], depth: int) -> None:
    box: PerKey[str, int] = PerKey(depth)
    waiting: dict[str, list[int]] = defaultdict(list)
    dropped: dict[str, int] = defaultdict(int)
    served = dict.fromkeys(KEYS, -1)
    for number, key in enumerate(steps):
        if key is not None:
            full = len(waiting[key]) == depth
            assert box.offer(key, number) == int(full)
            waiting[key] = [*waiting[key], number][-depth:]
            dropped[key] += full
            continue
        taken = box.take()
        if taken is None:
            assert not any(waiting.values())
            continue
        assert served[taken.key] == min(served[key] for key in KEYS if waiting[key])
        assert taken.item == waiting[taken.key].pop(0)
        assert taken.dropped == dropped.pop(taken.key, 0)
        served[taken.key] = number


@given(steps, st.integers(1, 4))
def test_fifo_against_a_model(steps: list[str | None], depth: int) -> None:
    box: Fifo[str, int] = Fifo(depth)
    waiting: list[tuple[str, int]] = []
    dropped: dict[str, int] = defaultdict(int)
    for number, key in enumerate(steps):
        if key is not None:
            waiting.append((key, number))
            assert box.offer(key, number) == int(len(waiting) > depth)
            if len(waiting) > depth:
                dropped[waiting.pop(0)[0]] += 1
            continue
        taken = box.take()
        if not waiting:
            assert taken is None
            continue
        first, item = waiting.pop(0)
        assert taken == Taken(first, item, dropped.pop(first, 0))


def test_a_fifo_keeps_no_more_bytes_than_it_may_but_always_the_newest_item() -> None:
    box: Fifo[str, bytes] = Fifo(100, 10, len)
    assert [box.offer("a", b"1234") for _ in range(3)] == [0, 0, 1]
    assert box.offer("b", b"x" * 99) == 2
    assert box.take() == Taken("b", b"x" * 99, 0)
    assert box.take() is None
    assert [box.offer("a", b"1234") for _ in range(2)] == [0, 0]
    assert box.take() == Taken("a", b"1234", 3)


def by_owner(depth: int = 100, most_bytes: int = 1_000_000) -> InTurn[str, bytes]:
    """Return a mailbox whose owners are the first letters of keys."""
    return InTurn(depth, most_bytes, len, lambda key: key[0])


def test_owners_are_served_in_turn_and_each_in_order() -> None:
    box = by_owner()
    for key, item in (("a1", b"1"), ("a2", b"2"), ("a1", b"3"), ("b1", b"4"), ("c1", b"5"), ("b1", b"6")):
        assert box.offer(key, item) == 0
    taken = [box.take() for _ in range(7)]
    assert [None if each is None else each.item for each in taken] == [b"1", b"4", b"5", b"2", b"6", b"3", None]
    assert taken[3] == Taken("a2", b"2", 0)


def test_who_has_most_loses_its_oldest_items() -> None:
    box = by_owner(depth=4)
    many = [b"%d" % number * 1_000 for number in range(9)]
    assert [box.offer("b", b"b"), *(box.offer("a", each) for each in many)] == [0] * 4 + [1] * 6
    assert box.offer("c", b"c") == 1
    assert [each for each in (box.take() for _ in range(5)) if each] == [
        Taken("b", b"b", 0),
        Taken("a", many[7], 7),
        Taken("c", b"c", 0),
        Taken("a", many[8], 0),
    ]


def test_a_large_item_makes_room_at_its_owner_and_one_alone_is_kept() -> None:
    box = by_owner(most_bytes=2 * OWNER_BYTES + 2_000)
    assert box.offer("a", b"x") == 0
    assert [box.offer("b", bytes(1_500)) for _ in range(3)] == [0, 1, 1]
    assert [box.take(), box.take(), box.take()] == [Taken("a", b"x", 0), Taken("b", bytes(1_500), 2), None]
    assert box.offer("a", bytes(9_999)) == 0
    assert box.take() == Taken("a", bytes(9_999), 0)


owned = st.lists(st.one_of(st.none(), st.tuples(st.sampled_from(KEYS), st.integers(0, 5_000))), max_size=60)


@given(owned, st.integers(1, 6), st.integers(1, 20_000))
def test_what_waits_in_turn_is_bounded_and_nothing_is_lost_untold(
    steps: list[tuple[str, int] | None], depth: int, most_bytes: int
) -> None:
    box = by_owner(depth, most_bytes)
    offered, dropped, taken = 0, 0, 0
    numbers: dict[str, list[int]] = defaultdict(list)
    told = 0
    for number, step in enumerate([*steps, *[None] * len(steps)]):
        if step is not None:
            offered += 1
            dropped += box.offer(step[0], number.to_bytes(2) + bytes(step[1]))
            assert offered - dropped - taken <= depth
        elif (found := box.take()) is not None:
            taken += 1
            told += found.dropped
            numbers[found.key].append(int.from_bytes(found.item[:2]))
    assert box.take() is None
    assert offered == taken + dropped
    assert told <= dropped
    assert all(each == sorted(each) for each in numbers.values())
