import pytest

from schemas.alerts import AlertState
from services.monitor.history.acts import Act
from services.monitor.history.archive import Archive, Asked
from services.monitor.history.errors import HistoryError
from services.monitor.history.settings import NONE
from tests.schemas.results import alert
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S

NOW_S = 1_700_000_000
"""Nanoseconds since the epoch need 64 bits."""


async def test_sightings_come_page_by_page_each_once_newest_first(url: str) -> None:
    some = [interval(NOW_S + second, NOW_S + second, name=name) for second in range(3) for name in ("box", "pallet")]
    async with opened(url) as store:
        await store.write(some, [], NOW_S * S)
    archive, found, after = Archive(url), [], None
    while page := await archive.sightings(Asked(), 4, after):
        found += page
        last = page[-1]
        after = (last.since_ns, last.key.robot, last.key.camera, last.name)
    assert found == some[::-1]


async def test_what_goes_on_is_of_now_though_it_began_long_ago(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2), interval(3, 3, is_open=True)], [], NOW_S * S)
    archive = Archive(url)
    assert await archive.sightings(Asked(since_ns=5 * S), 9) == [interval(3, NOW_S, is_open=True)]
    assert await archive.sightings(Asked(until_ns=2 * S), 9) == [interval(1, 2)]
    assert await archive.sightings(Asked(name="pallet"), 9) == []
    assert len(await archive.sightings(Asked(robot="r1", camera="front", name="box"), 9)) == 2


async def test_alerts_come_by_their_last_change_and_state_with_what_was_done(url: str) -> None:
    first = alert(id_="a1", changed_ns=NOW_S * S)
    second = alert(id_="a2", changed_ns=NOW_S * S, state=AlertState.ACKNOWLEDGED)
    act = Act("a2", AlertState.ACKNOWLEDGED, "ann", NOW_S * S)
    async with opened(url) as store:
        await store.write([], [first, second], NOW_S * S, [act])
    archive = Archive(url)
    assert await archive.alerts(Asked(), 1) == [second]
    assert await archive.alerts(Asked(), 9, (second.changed_ns, second.id)) == [first]
    assert await archive.alerts(Asked(), 9, states=[AlertState.RAISED]) == [first]
    assert await archive.acts(["a1", "a2"]) == [act]


async def test_without_a_history_there_is_nothing_to_read() -> None:
    with pytest.raises(HistoryError, match="--history none"):
        await Archive(NONE).sightings(Asked(), 1)
