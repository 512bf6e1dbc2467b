import pytest
from msgspec.structs import replace

from services.monitor.rules.timeline import NEVER, spoken_for
from tests.services.monitor.history.lasting import there
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import FRONT, S

TWICE = [
    replace(there(10, 23, camera="front"), heard_ns=20 * S),
    replace(there(100, 203, camera="front"), heard_ns=200 * S),
    there(220, 300, camera="front", is_open=True),
    there(1, 999, is_open=True),
]


@pytest.mark.parametrize(
    ("until_s", "lost_s"), [(9, None), (19, None), (20, 23), (21, 23), (24, None), (150, None), (200, 203), (250, None)]
)
def test_what_was_in_view_until_the_end_is_lost_when_the_camera_is_thought_silent(
    until_s: int, lost_s: int | None
) -> None:
    lost_ns = spoken_for(TWICE)[FRONT].lost_ns(interval(5, until_s))
    assert lost_ns == (None if lost_s is None else lost_s * S)


@pytest.mark.parametrize(
    ("since_s", "first"), [(9, False), (15, False), (99, True), (100, True), (101, False), (219, False), (250, False)]
)
def test_what_was_there_when_a_lost_camera_spoke_again_did_not_come(since_s: int, *, first: bool) -> None:
    assert spoken_for(TWICE)[FRONT].was_there_first(interval(since_s, 999)) == first


def test_of_a_camera_that_nobody_ever_spoke_for_nothing_is_known() -> None:
    assert set(spoken_for(TWICE)) == {FRONT}
    assert (NEVER.lost_ns(interval(1, 2)), NEVER.was_there_first(interval(1, 2))) == (None, False)
