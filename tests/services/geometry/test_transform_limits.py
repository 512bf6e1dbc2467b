"""How many transforms are kept, and which give way."""

import pytest

from schemas.space import MAX_COORDINATE_M
from schemas.transforms import Transforms
from services.geometry.errors import (
    TooOldError,
    UnknownFrameError,
)
from services.geometry.memory_budget import CROWDED, MemoryBudget
from services.geometry.transforms import (
    KEEP_NS,
    MAX_SAMPLES,
    MOST_SAMPLES,
    SAMPLE_BYTES,
    TOO_FAR,
    TransformTree,
)
from tests.schemas.frames import header
from tests.services.geometry.test_transforms import S, said, tree


def test_many_frames_share_the_room_that_there_is() -> None:
    made = TransformTree()
    count = 2 * MOST_SAMPLES // MAX_SAMPLES
    for number in range(count):
        made.add(said("map", f"frame{number}", at=0), static=False)
    for at in range(1, MAX_SAMPLES):
        made.add(said("map", "frame0", at=at * 1000), static=False)
    kept = MAX_SAMPLES // 2
    made.lookup("map", "frame0", (MAX_SAMPLES - kept) * 1000)
    with pytest.raises(TooOldError):
        made.lookup("map", "frame0", (MAX_SAMPLES - kept) * 1000 - 1)


def test_a_place_beyond_what_messages_carry_is_no_place() -> None:
    made = tree(said("map", "base", MAX_COORDINATE_M), said("map", "other", 2 * MAX_COORDINATE_M))
    assert made.rejected == {TOO_FAR: 1}
    assert made.lookup("map", "base", 0)[0, 3] == MAX_COORDINATE_M


def test_transforms_give_way_where_there_is_no_room_the_older_half_first_and_fixed_ones_never() -> None:
    budget = MemoryBudget(10 * SAMPLE_BYTES)
    made = TransformTree(budget=budget)
    made.take(Transforms(header=header(), transforms=[said("base", "camera", 1.0)]), static=True)
    for at in range(11):
        made.take(Transforms(header=header(), transforms=[said("map", "base", at, at=at)]), static=False)
    assert made.rejected == {CROWDED: 6}
    assert budget.taken == 5 * SAMPLE_BYTES
    assert made.lookup("map", "camera", 6)[0, 3] == 7
    with pytest.raises(TooOldError):
        made.lookup("map", "base", 5)


def test_a_frame_that_gave_way_as_a_whole_is_not_known_until_it_is_said_again() -> None:
    made = TransformTree(budget=MemoryBudget(SAMPLE_BYTES))
    made.take(Transforms(header=header(), transforms=[said("map", "slow"), said("map", "base")]), static=False)
    with pytest.raises(UnknownFrameError):
        made.lookup("map", "slow", 0)
    made.take(Transforms(header=header(), transforms=[said("map", "slow", 1.0, at=S)]), static=False)
    assert made.lookup("map", "slow", S)[0, 3] == 1


def test_room_is_for_what_is_kept_now() -> None:
    budget = MemoryBudget()
    made = TransformTree(budget=budget)
    for said_now in ([said("map", "base", at=S)], [said("map", "base", 1.0, at=S)], [said("odom", "base", at=3 * S)]):
        made.take(Transforms(header=header(), transforms=said_now), static=False)
        assert budget.taken == SAMPLE_BYTES
    made.take(Transforms(header=header(), transforms=[said("odom", "base", at=S)]), static=False)  # a clock jumped
    assert budget.taken == SAMPLE_BYTES
    made.take(Transforms(header=header(), transforms=[said("odom", "base", at=S + KEEP_NS + 1)]), static=True)
    assert budget.taken == SAMPLE_BYTES
    made.flush()
    assert budget.taken == 0
