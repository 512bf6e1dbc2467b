"""The fleet page: every robot, its state, and the objects in view of its cameras."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import Final

from nicegui import events, ui

from bus.session.links import is_loopback
from services.monitor.event_loop.cooperative_yielding import pause
from services.monitor.join_address import ALSO_ELSEWHERE, endpoint_to_join
from services.monitor.liveness import RobotState
from services.monitor.monitor import Monitor, RobotThereError, UnknownRobotError
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import FLEET, WALL, Confirmation, Tile
from services.monitor.web.pages.frame import REFRESH_S, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import SEARCH, Choices, Column, LiveTable, Loaded, RowWindow, search_field
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.formatting import ROBOT_BODY, ROBOT_CARD
from services.monitor.web.pages.rows.overview import robot_row
from services.monitor.web.pages.rows.robots import RobotFilter, Survey

COLUMNS: Final = (
    Column("state", "State"),
    Column("robot", "Robot"),
    Column("camera", "Camera", sortable=False),
    Column("classes", "In view", sortable=False),
    Column("age", "Age", align="right"),
    Column("rate", "Class lists", align="right"),
    Column("dropped", "Dropped", align="right"),
    Column("seen", "Last seen", align="right"),
)


def add_overview(shared: PageData, monitor: Monitor) -> None:
    """Add the page."""

    @page_at(FLEET.path)
    async def overview() -> None:
        async with page_frame(monitor, "Fleet", FLEET) as visitor:
            figures = _Figures()
            await pause()
            shown = _Overview(monitor, shared, figures, visitor)
            await pause()
            await shown.refresh()


class _Figures:
    """The number of robots in each state. chosen: called with a state when it is clicked."""

    def __init__(self) -> None:
        self.chosen: Callable[[RobotState], Awaitable[None]] | None = None
        with ui.element("div").classes("fs-tiles"):
            self._tiles = {
                state: Tile(state.capitalize(), dot=state, on_click=partial(self._click, state))
                for state in reversed(RobotState)
            }
            self._cameras = Tile("Cameras live")
            self._rate = Tile("Class lists")

    async def _click(self, state: RobotState) -> None:
        if self.chosen is not None:
            await self.chosen(state)

    def show(self, survey: Survey, chosen: RobotState | None) -> None:
        """Show the current figures."""
        every = survey.size
        for state, tile in self._tiles.items():
            count = survey.counts.get(state, 0)
            tile.show(f"{count:,}", f"of {every:,}" if state is RobotState.ONLINE else "", on=chosen is state)
            tile.color({RobotState.OFFLINE: "fs-bad", RobotState.ONLINE: ""}.get(state, "fs-warn") if count else "")
        self._cameras.show(f"{survey.live_cameras:,}", f"of {survey.cameras:,}")
        self._rate.show(f"{survey.rate_hz:,.0f}", "/s")


class _Overview:
    """One browser's view of the fleet."""

    def __init__(self, monitor: Monitor, shared: PageData, figures: _Figures, visitor: Visitor) -> None:
        self._monitor, self._shared, self._figures, self._visitor = monitor, shared, figures, visitor
        self._choices = Choices()
        state = next((each for each in RobotState if each == self._choices["state"]), None)
        self._wanted = RobotFilter(text=self._choices[SEARCH], state=state)
        figures.chosen = self._only
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                search_field("Robot, camera or class", self._look_for, self._wanted.text)
                self._found = ui.label().classes("fs-muted")
                ui.element("div").classes("fs-spring")
                with ui.link(target=WALL).classes("fs-link fs-small"):
                    ui.label("Wall screen")
            self._table = LiveTable(
                COLUMNS, self._load, row_key="robot", sort="state", body=ROBOT_BODY, card=ROBOT_CARD
            )
            self._table.table.on("forget", self._forget)
            self._no_robots = no_robots_yet(monitor)
            self._none = nothing_yet(
                "search_off", "No robot matches", "Clear the search, or choose another state above."
            )
        self._sure = Confirmation(
            "Forget",
            "Keep it",
            "It leaves every list until its gateway is back, and its alerts are resolved. Its history stays.",
        )
        ui.timer(REFRESH_S, self.refresh, immediate=False)

    async def refresh(self) -> None:
        """Show the fleet as it is now."""
        await self._table.refresh()

    async def _load(self, window: RowWindow) -> Loaded:
        survey = await self._shared.survey()
        wanted = replace(self._wanted, sort=window.sort, descending=window.descending)
        robots = await survey.robots(wanted)
        shown = robots[window.begin : window.end]
        may_act = self._may_act
        rows = [robot_row(survey.robot(name), survey.now_ns, may_act=may_act) for name in shown]
        return Loaded(rows, len(robots), partial(self._count, survey, len(robots)))

    @property
    def _may_act(self) -> bool:
        return self._visitor.may_act and self._monitor.history.status.leads

    def _count(self, survey: Survey, found: int) -> None:
        every = survey.size
        self._figures.show(survey, self._wanted.state)
        self._found.set_text(f"{found:,} of {every:,} robots" if found != every else "")
        self._no_robots.set_visibility(not every)
        self._none.set_visibility(bool(every) and not found)

    async def _forget(self, event: events.GenericEventArguments) -> None:
        robot = str(event.args)
        if not self._may_act:
            ui.notify("Only operators may do that, at the monitor that raises the alerts.", type="warning")
        elif await self._sure.given(f"Forget {robot}?"):
            try:
                self._monitor.forget(robot, self._visitor.name)
            except (UnknownRobotError, RobotThereError) as error:
                ui.notify(str(error), type="info")
            await self.refresh()

    async def _only(self, state: RobotState) -> None:
        self._wanted = replace(self._wanted, state=None if self._wanted.state is state else state)
        self._choices.keep("state", self._wanted.state or "")
        await self._table.begin()

    async def _look_for(self, text: str) -> None:
        self._wanted = replace(self._wanted, text=text)
        self._choices.keep(SEARCH, text)
        await self._table.begin()


def no_robots_yet(monitor: Monitor) -> ui.html:
    """Add a notice that no robot has joined, and how to start one; return it."""
    endpoint = endpoint_to_join(monitor.settings)
    return nothing_yet(
        "smart_toy",
        "No robot has joined yet",
        "Start a gateway beside a robot's ROS master; it shows up here within a second:",
        command=f"fleetsight gateway --robot r1 --connect {endpoint}",
        more=ALSO_ELSEWHERE if is_loopback(endpoint) else "",
    )
