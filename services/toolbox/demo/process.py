"""Starts the demo's processes, watches the fleet, stops everything and sums up."""

import asyncio
import json
import logging
import secrets
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Self

from rich.console import Console

from bus import open_bus
from bus.clocks import clock_id
from schemas.printing import printable
from services.detector.settings import is_weights, shipped_file
from services.monitor.display import notes_of, show
from services.monitor.fleet import Fleet
from services.monitor.monitor import Monitor
from services.monitor.process import running
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.passwords import Passwords
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Role, User
from services.monitor.web.process import Web, WebError
from services.simulator.fleet import warehouse_seed
from services.simulator.floor_plan import write_floor_plan
from services.toolbox.demo.children import Child, ChildFailedError, child, free_ports
from services.toolbox.demo.processors import ProcessorClock
from services.toolbox.demo.settings import SEED, DemoSettings
from services.toolbox.demo.summary import Summary
from services.toolbox.process import EXIT_FAILED

log = logging.getLogger(__name__)

LAST_WORDS_S: Final = 0.2
"""Seconds for the last messages of stopped processes to arrive."""

REFRESH_S: Final = 0.5

USER: Final = "demo"
RULES: Final = Path(__file__).parent / "rules.yaml"


@dataclass(frozen=True, slots=True)
class Page:
    """The demo's page: a monitor's settings with its own history, a web server on a free port, and how to log in."""

    settings: MonitorSettings
    web: Web
    note: str

    @classmethod
    async def of(cls, endpoint: str, folder: Path) -> Self:
        """Make the page for a demo whose bus listens at `endpoint`; `folder` holds its data."""
        history, password = f"sqlite:///{folder / 'history.db'}", secrets.token_urlsafe(9)
        hashed = await Passwords().hash(password)
        await UserStore(history).add(User(USER, Role.OPERATOR, hashed, time.time_ns()))
        floor_plan = folder / "map.yaml"
        await asyncio.to_thread(write_floor_plan, floor_plan, warehouse_seed(SEED))
        settings = MonitorSettings(listen=[endpoint], history=history, rules=RULES, floor_plan=floor_plan)
        try:
            web = Web.of(settings)
        except WebError:
            settings = settings.model_copy(update={"web_port": 0})
            web = Web.of(settings)
        return cls(settings, web, f"page: {web.url} (log in as {USER} with {password})")


async def run(settings: DemoSettings) -> int:
    """Run the demo until its time is over or it is cancelled, print the summary, return 0 if every robot was seen."""
    with TemporaryDirectory(prefix="fleetsight-demo-") as folder:
        return await _run(settings, Path(folder))


async def _run(settings: DemoSettings, folder: Path) -> int:
    began_s, processors = time.monotonic(), ProcessorClock()
    console = Console()
    port = free_ports(1 + settings.robots)
    endpoint = f"tcp/127.0.0.1:{port}"
    commands = plan(settings, endpoint, port + 1)
    children: dict[str, Child] = {}
    ended_well = True
    fleet = Fleet(clock_id())
    page = await Page.of(endpoint, folder)
    try:
        async with open_bus(page.settings) as bus, running(page.settings, bus, fleet) as monitor:
            try:
                await _show_until_over(commands, children, monitor, page, console, seconds=settings.seconds)
            finally:
                await asyncio.sleep(LAST_WORDS_S)
    except* ChildFailedError as failed:
        for error in _leaves(failed):
            log.error("%s", error)  # noqa: TRY400 - the process's own words say more than our stack
        ended_well = False
    finally:
        output = children["simulator"].output if "simulator" in children else []
        sent = json.loads(output[-1])["sent"] if output else {}
        summary = Summary.of(fleet, _robots(settings), sent, began_s, processors.use())
        console.print(
            "\n".join([*summary.lines(), *notes_of(fleet.left_out)]), markup=False, highlight=False, soft_wrap=True
        )
    return 0 if ended_well and summary.complete else EXIT_FAILED


def plan(settings: DemoSettings, endpoint: str, master_port: int) -> Mapping[str, Sequence[str]]:
    """Return each process's command line by name; the robots' ROS masters use `master_port` and the ports after it."""
    # Weights under torch at once: quicker runtimes need an export first, which takes longer than most demos.
    model = settings.model or str(shipped_file(None, None))
    runtime = "torch" if is_weights(model) else "onnx"
    simulator = [
        *("simulate", "--robots", str(settings.robots), "--hz", str(settings.hz), "--summary"),
        *("--seed", str(SEED), "--warehouses", "1"),  # so that all of them are on one map
        *("--master-port", str(master_port)),
    ]
    gateways = {
        f"gateway {robot}": [
            *("gateway", "--robot", robot, "--connect", endpoint),
            *("--ros-master", f"http://127.0.0.1:{port}", "--ros-host", "127.0.0.1"),
        ]
        for port, robot in enumerate(_robots(settings), master_port)
    }
    detector = ["detector", "--connect", endpoint, "--runtime", runtime, "--model", model]
    measuring = {service: [service, "--connect", endpoint] for service in ("distance", "cloud", "worldmodel")}
    return {"simulator": simulator, **gateways, **measuring, "detector": detector}


def _robots(settings: DemoSettings) -> list[str]:
    return [f"r{number}" for number in range(1, settings.robots + 1)]


async def _show_until_over(
    commands: Mapping[str, Sequence[str]],
    children: dict[str, Child],
    monitor: Monitor,
    page: Page,
    console: Console,
    *,
    seconds: float | None,
) -> None:
    ending = asyncio.Event()

    def say(line: str) -> None:
        if not ending.is_set():  # while stopping, each process reports the others missing
            console.print(printable(line), markup=False, highlight=False, soft_wrap=True, style="dim")

    note = f"{len(commands)} processes; Ctrl-C stops them all" if seconds is None else f"stops after {seconds:g} s"
    notes = [note, page.note]
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(_keep(name, command, children, say)) for name, command in commands.items()]
        tasks.append(group.create_task(page.web.run(monitor)))
        tasks.append(group.create_task(show(monitor.fleet, console, REFRESH_S, note="\n".join(notes))))
        if not console.is_terminal:  # where it stays below the table
            tasks.append(group.create_task(_say_again(page.note, monitor.fleet, console)))
        try:
            await (asyncio.sleep(seconds) if seconds is not None else asyncio.Event().wait())
        finally:
            ending.set()
        for task in tasks:
            task.cancel()


async def _say_again(note: str, fleet: Fleet, console: Console) -> None:
    """Print the page's address once there is something to see: other output has scrolled it away."""
    while fleet.first_list_s is None:  # noqa: ASYNC110 - nobody tells
        await asyncio.sleep(REFRESH_S)
    console.print(note, markup=False, highlight=False, soft_wrap=True)


async def _keep(name: str, command: Sequence[str], children: dict[str, Child], say: Callable[[str], None]) -> None:
    async with child(name, command, say) as started:
        children[name] = started
        await started.ended()


def _leaves(group: BaseExceptionGroup[ChildFailedError]) -> Iterator[ChildFailedError]:
    for error in group.exceptions:
        if isinstance(error, BaseExceptionGroup):
            yield from _leaves(error)
        else:
            yield error
