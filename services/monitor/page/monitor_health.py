"""How the monitor itself is doing."""

import time
from collections.abc import Iterator

from nicegui import ui

from services.monitor.history.settings import NONE
from services.monitor.joining import endpoints_to_join
from services.monitor.monitor import Monitor
from services.monitor.page.formatting import NS, lasting
from services.monitor.troubles import shortened


class MonitorHealth:
    """A list of what a monitor says of itself."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        with ui.element("div").classes("fs-facts"):
            self._labels = []
            for what, _ in facts(monitor, time.time_ns()):
                ui.label(what)
                self._labels.append(ui.label())

    def refresh(self) -> None:
        """Say it as it is now."""
        for label, (_, fact) in zip(self._labels, facts(self._monitor, time.time_ns()), strict=True):
            label.set_text(fact)


def facts(monitor: Monitor, now_ns: int) -> Iterator[tuple[str, str]]:
    """Yield what a monitor says of itself: always the same things in the same order."""
    history, settings = monitor.history.status, monitor.settings
    yield "Running for", lasting((now_ns - monitor.started_ns) / NS)
    yield "Robots join at", ", ".join(endpoints_to_join(settings)) or "what scouting finds"
    if settings.history == NONE:
        kept = "not kept: started with --history none"
    else:
        kept = f"not kept: {history.problem}" if history.problem else "kept"
        kept += f", {history.pending:,} rows wait to be written" if history.pending else ""
        kept += f", {history.lost:,} given up" if history.lost else ""
    yield "History", kept
    yield (
        "Alerts",
        "raised here"
        if history.leads
        else f"raised by another monitor{f' ({history.leader})' if history.leader else ''}",
    )
    rules = len(monitor.rules.book.rules)
    in_force = "; ".join([f"{rules} in force", *shortened(monitor.rule_remarks())])
    yield "Rules", monitor.rules.problem or (in_force if rules else "none: start with --rules rules.yaml")
    left_out = ", ".join(f"{count:,} {what}" for what, count in sorted(monitor.fleet.left_out.items()) if count)
    yield "Left out", left_out or "nothing"
