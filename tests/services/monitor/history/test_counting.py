"""How many were in view over time, as either database counts it."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schemas.keys import CameraKey
from services.monitor.history import counting as module
from services.monitor.history.archive import Archive, HistoryQuery
from services.monitor.history.counting import SLOTS, Counts
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Interval
from tests.services.monitor.history.support.stored_intervals import there
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S

NOW_S = 1_700_000_000
HOUR = HistoryQuery((NOW_S - 3_600) * S, NOW_S * S)
SLOT_S = 3_600 // SLOTS


async def counts(url: str, *some: StoredInterval, asked: HistoryQuery = HOUR, heartbeat_s: int = NOW_S) -> Counts:
    async with opened(url) as store:
        await store.write(some, [], heartbeat_s * S)
    return await Archive(url).counts(asked)


def at(ago_s: int) -> int:
    """Return the slot of some time ago."""
    return (3_600 - ago_s) // SLOT_S


@pytest.fixture(params=["counted", "looked at"])
def either_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Count exactly, or look at moments."""
    if request.param == "looked at":
        monkeypatch.setattr(module, "EXACT", 0)
    return str(request.param)


async def test_cameras_add_up_and_what_goes_on_is_there_until_the_end(url: str, either_way: str) -> None:
    rear = CameraKey("r1", "rear")
    found = await counts(
        url,
        interval(NOW_S - 7_200, NOW_S - 1_800),
        interval(NOW_S - 2_400, NOW_S - 1_200, key=rear),
        interval(NOW_S - 600, NOW_S - 600, is_open=True),
        interval(NOW_S - 9_000, NOW_S - 8_000, name="pallet"),
        there(NOW_S - 9_000, NOW_S, camera="front", is_open=True),
    )
    assert found.most.keys() == {"box"}, either_way
    wanted = {3_599: 2, 2_405: 2, 2_395: 4, 1_805: 4, 1_795: 2, 1_205: 2, 1_195: 0, 605: 0, 595: 2, 1: 2}
    assert {ago: found.most["box"].get(at(ago), 0) for ago in wanted} == wanted
    assert found.known == set(range(SLOTS))


async def test_it_is_not_known_what_was_in_view_while_no_camera_was_available(url: str, either_way: str) -> None:
    found = await counts(
        url,
        there(NOW_S - 3_000, NOW_S - 2_000, camera="front"),
        there(NOW_S - 2_500, NOW_S - 1_500, "r2", camera="front"),
        there(NOW_S - 4_000, NOW_S, is_open=True),  # a robot whose cameras say nothing
        there(NOW_S - 4_000, NOW_S, "", is_open=True),
        interval(NOW_S - 1_000, NOW_S - 900),
    )
    wanted = {3_599: False, 3_005: False, 2_995: True, 1_505: True, 1_495: False, 995: True, 905: True, 1: False}
    assert {ago: at(ago) in found.known for ago in wanted} == wanted, either_way
    only = await Archive(url).counts(HistoryQuery(HOUR.since_ns, HOUR.until_ns, robot="r2"))
    assert (at(2_995) in only.known, at(2_495) in only.known) == (False, True)


async def test_what_goes_on_does_so_until_the_monitor_was_last_there(url: str, either_way: str) -> None:
    began_s = NOW_S - 3_000
    goes_on = (interval(began_s, began_s, is_open=True), there(began_s, began_s, camera="front", is_open=True))
    found = await counts(url, *goes_on, heartbeat_s=NOW_S - 600)
    wanted = {3_005: False, 2_995: True, 605: True, 595: False, 1: False}
    assert {ago: at(ago) in found.known for ago in wanted} == wanted, either_way
    assert {ago: bool(found.most["box"].get(at(ago))) for ago in wanted} == wanted


async def test_the_most_of_a_slot_is_told_however_short_it_was(url: str) -> None:
    found = await counts(url, *(interval(NOW_S - ago, NOW_S - ago + 1) for ago in range(1, 3_600, 2)))
    assert set(found.most["box"].values()) == {2}
    assert len(found.most["box"]) == SLOTS


async def test_one_count_follows_another_and_both_are_not_added(url: str) -> None:
    found = await counts(url, interval(NOW_S - 200, NOW_S - 100), interval(NOW_S - 100, NOW_S - 50))
    assert max(found.most["box"].values()) == 2


async def test_it_is_counted_of_what_is_asked_for(url: str, either_way: str) -> None:
    some = [
        interval(NOW_S - 200, NOW_S, key=CameraKey(robot, "front"), name=name)
        for robot in ("r1", "r2")
        for name in ("box", "pallet")
    ]
    await counts(url, *some)
    since_ns, until_ns = HOUR.since_ns, HOUR.until_ns
    for asked, names in (
        (HistoryQuery(since_ns, until_ns, robot="r2"), {"box": 2, "pallet": 2}),
        (HistoryQuery(since_ns, until_ns, name="box"), {"box": 4}),
        (HistoryQuery(since_ns, until_ns, camera="rear"), {}),
        (HistoryQuery(since_ns, until_ns, text="PALL"), {"pallet": 4}),
        (HistoryQuery(since_ns, until_ns, text="r1"), {"box": 2, "pallet": 2}),
    ):
        found = await Archive(url).counts(asked)
        assert {name: max(of.values()) for name, of in found.most.items()} == names, (either_way, asked)


@pytest.mark.parametrize("of", [{"robot": "r1"}, {"camera": "front"}, {"name": "forklift"}])
async def test_one_camera_or_class_is_counted_exactly_however_much_others_saw(
    url: str, monkeypatch: pytest.MonkeyPatch, of: dict[str, str]
) -> None:
    monkeypatch.setattr(module, "EXACT", 100)
    short = [interval(NOW_S - ago, NOW_S - ago + 1, name="forklift") for ago in range(60, 3_600, 60)]
    began = interval(NOW_S - 9_000, NOW_S - 3_500, name="forklift", key=CameraKey("r1", "left"))
    goes_on = interval(NOW_S - 5, NOW_S - 5, name="forklift", key=CameraKey("r1", "front"), is_open=True)
    before = [interval(NOW_S - 9_000 + ago, NOW_S - 8_999 + ago, name="forklift") for ago in range(0, 4_000, 10)]
    others = [
        interval(NOW_S - ago, NOW_S - ago + 1, key=CameraKey(f"r{2 + ago % 9}", "rear")) for ago in range(1, 3_600, 9)
    ]
    available = [there(NOW_S - ago, NOW_S - ago + 20, f"r{2 + ago % 9}", "rear") for ago in range(1, 3_600, 9)]
    some = (*short, began, goes_on, *before, *others, *available, there(NOW_S - 9_000, NOW_S, "r1", "front"))
    found = await counts(url, *some, asked=HistoryQuery(HOUR.since_ns, HOUR.until_ns, **of))
    wanted = {at(ago) for ago in range(60, 3_600, 60)} | {at(1)}
    if "camera" not in of:
        wanted |= {at(ago) for ago in range(3_501, 3_600)}
    if "name" in of:
        assert set(found.most["forklift"]) == {slot * found.slots.number // SLOTS for slot in wanted}
    else:
        assert set(found.most["forklift"]) == wanted
        assert found.known == set(range(SLOTS))


@given(st.lists(st.tuples(st.integers(0, 3_000), st.integers(1, 900), st.integers(0, 4)), max_size=40))
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
async def test_counted_exactly_it_is_the_most_of_each_slot(
    tmp_path_factory: pytest.TempPathFactory, made: list[tuple[int, int, int]]
) -> None:
    some: dict[tuple[int, int], Interval] = {}
    for begin, length, robot in made:
        key = CameraKey(f"r{robot}", "front")
        some[begin, robot] = interval(NOW_S - 3_600 + begin, NOW_S - 3_600 + begin + length, key=key)
    found = await counts(f"sqlite:///{tmp_path_factory.mktemp('counting')}/history.db", *some.values())
    begins = [(each.since_ns - HOUR.since_ns, each.until_ns - HOUR.since_ns) for each in some.values()]

    def at_once(moment_ns: int) -> int:
        return 2 * sum(begin <= moment_ns < end for begin, end in begins)

    moments = [0, *(moment for both in begins for moment in both)]
    wanted: dict[int, int] = {}
    for slot in range(SLOTS):
        first_ns, last_ns = slot * SLOT_S * S, (slot + 1) * SLOT_S * S
        inside = [at_once(moment) for moment in moments if first_ns <= moment < last_ns]
        wanted[slot] = max([at_once(first_ns), *inside])
    assert found.most.get("box", {}) == {slot: count for slot, count in wanted.items() if count}
