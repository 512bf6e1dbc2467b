from __future__ import annotations

from random import Random

import pytest

from tests.fuzz.mutation import MAX_BYTES, OPERATIONS, mutate, pieces

SEEDS = [b"", b"\x00", b"abc", b"5 apples, 17 pears", bytes(range(200))]


def seeded() -> Random:
    return Random(1)  # noqa: S311 - no secret


@pytest.mark.parametrize("operation", OPERATIONS)
def test_every_operation_takes_anything_and_does_something(operation: object) -> None:
    assert callable(operation)
    rng, changed = seeded(), 0
    for _ in range(200):
        data = bytearray(rng.choice(SEEDS))
        before = bytes(data)
        operation(rng, data, SEEDS)
        changed += data != before
    assert changed > 20


def test_the_same_seed_makes_the_same_inputs_and_they_are_bounded() -> None:
    first, second = seeded(), seeded()
    inputs = [mutate(first, SEEDS) for _ in range(1000)]
    assert inputs == [mutate(second, SEEDS) for _ in range(1000)]
    assert len(set(inputs)) > 500
    assert max(map(len, inputs)) <= MAX_BYTES


@pytest.mark.parametrize("data", SEEDS)
def test_pieces_are_the_whole(data: bytes) -> None:
    rng = seeded()
    assert all(b"".join(pieces(rng, data)) == data for _ in range(200))
