import asyncio
from pathlib import Path

from bus.fake import FakeNetwork
from services.monitor.web.pages.health import facts
from tests.contract.waiting import until
from tests.services.monitor.web.serving import monitor_on

S = 1_000_000_000


async def test_a_monitor_says_how_it_is() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        monitor.fleet.left_out["malformed messages"] += 1_200
        said = dict(facts(monitor, monitor.started_ns + 65 * S))
    assert said["Robots join at"] == "tcp/127.0.0.1:7447"
    assert said["Running for"] == "1 min"
    assert said["History"] == "not kept: started with --history none"
    assert said["Rules"] == "none: start with --rules rules.yaml"
    assert said["Left out"] == "1,200 malformed messages"


async def test_a_monitor_whose_database_is_not_there_yet_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    async with FakeNetwork().open_bus() as bus, asyncio.TaskGroup() as group:
        monitor = monitor_on(bus, history=f"sqlite:///{tmp_path}/file/history.db")
        keeping = group.create_task(monitor.history.run())
        await until(lambda: bool(monitor.history.status.problem))
        said = dict(facts(monitor, monitor.started_ns))
        keeping.cancel()
    assert said["History"].startswith("not kept: ")
