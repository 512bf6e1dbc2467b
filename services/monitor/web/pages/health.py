"""The health page: workers, gateways and the monitor itself; which worker serves which camera, and problems."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

from nicegui import ui

from schemas.keys import CameraKey
from services.monitor.formats import limited, natural
from services.monitor.history.settings import NONE
from services.monitor.join_address import endpoint_to_join, endpoints_to_join
from services.monitor.monitor import Monitor
from services.monitor.web.pages.components import HEALTH, panel
from services.monitor.web.pages.frame import REFRESH_S, banner, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import SEARCH, Choices, Column, LiveTable, Loaded, RowWindow, search_field
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.formatting import NS, lasting
from services.monitor.web.pages.rows.health import (
    GATEWAY_BODY,
    GATEWAY_CARD,
    WORKER_BODY,
    WORKER_CARD,
    gateway_row,
    worker_row,
)
from services.monitor.web.pages.rows.robots import RobotFilter


class MonitorHealth:
    """The list of facts about a monitor."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        with ui.element("div").classes("fs-facts"):
            self._labels = []
            for what, _ in facts(monitor, time.time_ns()):
                ui.label(what)
                self._labels.append(ui.label())

    def refresh(self) -> None:
        """Show the current facts."""
        for label, (_, fact) in zip(self._labels, facts(self._monitor, time.time_ns()), strict=True):
            label.set_text(fact)


def facts(monitor: Monitor, now_ns: int) -> Iterator[tuple[str, str]]:
    """Yield the facts about a monitor: always the same ones in the same order."""
    history, settings = monitor.history.status, monitor.settings
    yield "Running for", lasting((now_ns - monitor.started_ns) / NS)
    yield "Robots join at", ", ".join(endpoints_to_join(settings)) or "what scouting finds"
    if settings.history == NONE:
        kept = "not kept: started with --history none"
    else:
        kept = f"not kept: {history.problem}" if history.problem else "kept"
        kept += f", {history.pending:,} rows waiting to be written" if history.pending else ""
        kept += f", {history.lost:,} dropped" if history.lost else ""
    yield "History", kept
    yield (
        "Alerts",
        "raised here"
        if history.leads
        else f"raised by another monitor{f' ({history.leader})' if history.leader else ''}",
    )
    rules = len(monitor.rules.book.rules)
    in_force = "; ".join([f"{rules} in force", *limited(monitor.rule_remarks())])
    yield "Rules", monitor.rules.problem or (in_force if rules else "none: start with --rules rules.yaml")
    yield "Models", _models(monitor)
    yield "World models", _world_models(monitor, now_ns)
    left_out = ", ".join(f"{count:,} {what}" for what, count in sorted(monitor.fleet.left_out.items()) if count)
    yield "Left out", left_out or "nothing"
    yield "Class lists rejected", _refused(monitor)
    ignored = monitor.fleet.inventory.ignored_opinions
    yield (
        "Second opinions ignored",
        f"{ignored:,} that were duplicate, late, or of cameras that are not known" if ignored else "none",
    )
    late = monitor.fleet.inventory.ignored_distances
    yield "Distances ignored", f"{late:,} that were duplicate, late or out of order" if late else "none"


def _refused(monitor: Monitor) -> str:
    refused = monitor.fleet.inventory.refused
    if not monitor.fleet.refused_lists:
        return "none"
    named = ", ".join(f"{key} {count:,}" for key, count in refused.most_common(MAX_NAMED))
    rest = f" and {len(refused) - MAX_NAMED:,} more cameras" if len(refused) > MAX_NAMED else ""
    which = f"{named or 'of cameras gone'}{rest}"
    return f"{monitor.fleet.refused_lists:,} that were duplicate, late or out of order: {which}"


def _models(monitor: Monitor) -> str:
    if monitor.models is None:
        return "not kept: started without --models"
    if (state := monitor.models.state) is None:
        return "not served here"
    in_force, canary = state.find(state.in_force), state.find(state.canary)
    told = "none is in force" if in_force is None else f"{in_force.label} is in force"
    if canary is None:
        return told
    robots = ", ".join(state.robots[:MAX_NAMED])
    rest = f" and {len(state.robots) - MAX_NAMED} more" if len(state.robots) > MAX_NAMED else ""
    return f"{told}; canary {canary.label} for {robots}{rest}"


def _world_models(monitor: Monitor, now_ns: int) -> str:
    """Return the sites that world models look after, and what is wrong with them."""
    if not monitor.fleet.world.on:
        return "not followed: started with --world off"
    names = [f"{each.site} by {each.worker}" for each in monitor.fleet.sites.current(now_ns)]
    if not names:
        return "none runs: fleetsight worldmodel keeps each object of a site once"
    rest = f" and {len(names) - MAX_NAMED:,} more sites" if len(names) > MAX_NAMED else ""
    problems = [*monitor.fleet.world.problems(), *monitor.fleet.sites.problems(now_ns)]
    return "; ".join([", ".join(names[:MAX_NAMED]) + rest, *limited(problems)])


MAX_NAMED: Final = 6

WORKER_COLUMNS: Final = (
    Column("state", "State"),
    Column("worker", "Worker"),
    Column("model", "Model", sortable=False),
    Column("count", "Serves"),
    Column("rate", "Rate", align="right"),
    Column("frames", "Frames", align="right", sortable=False),
    Column("dropped", "Dropped", align="right", sortable=False),
    Column("seen", "Last heard", align="right"),
)

GATEWAY_COLUMNS: Final = (
    Column("state", "State"),
    Column("robot", "Robot"),
    Column("stream", "Stream", sortable=False),
    Column("topic", "ROS topic", sortable=False),
    Column("in", "In", align="right", sortable=False),
    Column("out", "Out", align="right", sortable=False),
    Column("dropped", "Dropped", align="right"),
    Column("served", "Served by", sortable=False),
)


def add_health(shared: PageData, monitor: Monitor) -> None:
    """Add the page."""

    @page_at(HEALTH.path)
    async def health() -> None:
        async with page_frame(monitor, "Health", HEALTH):
            await _Health(shared, monitor).refresh()


class _Health:
    """One browser's view of the health."""

    def __init__(self, shared: PageData, monitor: Monitor) -> None:
        self._monitor, self._shared = monitor, shared
        self._choices = Choices()
        self._wanted = RobotFilter(text=self._choices[SEARCH])
        self._unserved = ui.element("div")
        with self._unserved:
            self._unserved_text = banner("")
        with panel("Workers"):
            self._workers = LiveTable(
                WORKER_COLUMNS, self._load_workers, row_key="id", sort="state", body=WORKER_BODY, card=WORKER_CARD
            )
            self._no_worker = nothing_yet(
                "memory",
                "No worker has reported yet",
                "Cameras need a detector. Start one on a machine with a CPU or GPU to spare:",
                command=f"fleetsight detector --connect {endpoint_to_join(monitor.settings)}",
            )
        with panel("Gateways"):
            with ui.element("div").classes("fs-panel-head"):
                search_field("Robot, camera or class", self._look_for, self._wanted.text)
            self._gateways = LiveTable(
                GATEWAY_COLUMNS,
                self._load_gateways,
                row_key="robot",
                sort="state",
                body=GATEWAY_BODY,
                card=GATEWAY_CARD,
            )
            self._no_gateway = nothing_yet(
                "smart_toy", "No gateway has joined", "Each robot runs its own; the Fleet page shows how to start one."
            )
            self._none = nothing_yet("search_off", "No gateway matches", "Clear the search.")
        with panel("This monitor"):
            self._itself = MonitorHealth(monitor)
        ui.timer(REFRESH_S, self.refresh, immediate=False)

    async def refresh(self) -> None:
        """Show the current state."""
        await self._workers.refresh()
        await self._gateways.refresh()
        self._itself.refresh()
        self._warn(await (await self._shared.survey()).unserved())

    def _warn(self, alone: Sequence[CameraKey]) -> None:
        self._unserved.set_visibility(bool(alone))
        if alone:
            named = ", ".join(map(str, alone[:MAX_NAMED]))
            rest = f" and {len(alone) - MAX_NAMED:,} more" if len(alone) > MAX_NAMED else ""
            self._unserved_text.set_text(f"No detector serves {named}{rest}. Start one to see what is in view.")

    async def _load_workers(self, window: RowWindow) -> Loaded:
        await self._shared.survey()  # updates the rates
        workers = sorted(
            self._monitor.fleet_view().workers.lines, key=lambda worker: (not worker.online, natural(worker.name))
        )
        rates = self._shared.rates
        match window.sort:
            case "worker":
                workers.sort(key=lambda worker: natural(worker.name))
            case "count":
                workers.sort(key=lambda worker: len(worker.serves))
            case "rate":
                workers.sort(key=lambda worker: rates.get(worker.name, 0.0))
            case "seen":
                workers.sort(key=lambda worker: worker.last_ns)
        if window.descending:
            workers.reverse()
        now_ns = time.time_ns()
        shown = workers[window.begin : window.end]
        rows = [worker_row(worker, rates.get(worker.name, 0.0), now_ns) for worker in shown]
        return Loaded(rows, len(workers), partial(self._no_worker.set_visibility, not workers))

    async def _load_gateways(self, window: RowWindow) -> Loaded:
        survey = await self._shared.survey()
        robots = await survey.robots(replace(self._wanted, sort=window.sort, descending=window.descending))
        shown = robots[window.begin : window.end]
        rows = [gateway_row(survey.robot(name), survey.now_ns) for name in shown]
        return Loaded(rows, len(robots), partial(self._count_gateways, len(robots), survey.size))

    def _count_gateways(self, found: int, every: int) -> None:
        self._no_gateway.set_visibility(not every)
        self._none.set_visibility(bool(every) and not found)

    async def _look_for(self, text: str) -> None:
        self._wanted = replace(self._wanted, text=text)
        self._choices.keep(SEARCH, text)
        await self._gateways.begin()
