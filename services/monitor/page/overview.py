"""The fleet: every robot, how it is, and what its cameras see."""

from nicegui import ui

from services.monitor.monitor import Monitor
from services.monitor.page.frame import FLEET, page_frame
from services.monitor.page.shared import Shared


def add_overview(monitor: Monitor, shared: Shared) -> None:
    """Add the page."""

    @ui.page(FLEET.path)
    async def overview() -> None:
        with page_frame(monitor, "Fleet", FLEET):
            survey = await shared.survey()
            ui.label(f"{len(survey.picture.robots)} robots")
