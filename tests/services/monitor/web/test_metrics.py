import pytest

from bus import BusSettings, open_bus
from bus.fake import FakeNetwork
from bus.session.link_use import LinkUse
from services.monitor.web.metrics import metrics_of
from tests.contract.conftest import free_endpoint
from tests.contract.waiting import until
from tests.services.monitor.web.serving import monitor_on


async def test_links_are_counted_against_how_many_there_can_be() -> None:
    endpoint = free_endpoint()
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus:
        monitor = monitor_on(bus)
        async with open_bus(BusSettings(connect=[endpoint])), open_bus(BusSettings(connect=[endpoint])):
            await until(lambda: bus.links.count == 2)
            said = (await metrics_of(monitor)).decode().splitlines()
            assert "fleetsight_links 2.0" in said
            assert f"fleetsight_links_limit {float(bus.links.limit)}" in said
        await until(lambda: bus.links.count == 0)
        assert monitor.problems() == []


async def test_links_that_are_nearly_all_taken_are_a_problem_of_the_monitor(monkeypatch: pytest.MonkeyPatch) -> None:
    async with FakeNetwork().open_bus() as bus:
        monkeypatch.setattr(type(bus), "links", LinkUse(9, 10))
        monitor = monitor_on(bus)
        assert monitor.problems() == [LinkUse(9, 10).problem]
        assert "fleetsight_mesh_up 1.0" in (await metrics_of(monitor)).decode()
