from bus.fake import FakeNetwork
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.robots import RobotFilter
from tests.services.monitor.web.serving import monitor_on


async def test_all_who_look_at_once_share_what_they_see() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        monitor.fleet.robot_presence("r1", alive=True)
        shared = PageData(monitor)
        survey = await shared.survey()
        assert await shared.survey() is survey
        assert await survey.robots(RobotFilter()) == ["r1"]
        assert (await shared.stock()).entries == ()
