"""The fleet that suffers: a robot in a network of its own, and the centre; every role is a process of its own.

robot    ROS master, simulator, gateway (--uplink-mbit, --listen), distance and cloud beside it
centre   router, a second router (for roaming), detector worker, world model, monitor, PostgreSQL
"""

import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

from benchmarks.chaos.database import Database
from benchmarks.chaos.network import Network
from benchmarks.chaos.observer import FRONT, Observer
from benchmarks.chaos.store import Journal, Store
from benchmarks.gateway.processes import ROSMASTER, PeerError, Process, running
from bus import BusSettings, open_bus
from services.access.fleet_file import FleetFile
from services.access.rules import access_control
from services.toolbox.demo.children import free_ports
from services.whole_file import write_whole

HZ: Final = 4.0
FRAMES: Final = 20
FRAME_MS: Final = 20.0
UPLINK_MBIT: Final = 1.8
"""What the thin link carries, less a tenth: a robot's budget is what its link carries at its worst."""

DISK: Final = "disk"
"""The folder, on a file system of its own where there may be one, of all that is kept: history and world model."""

UNIT_RESTART_S: Final = 3.0
"""RestartSec of the systemd units: so long a process that was killed is down."""

LISTS: Final = ("--appear-lists", "1", "--vanish-lists", "1", "--vanish-s", "0")
"""Each class list counts by itself, so that each makes an interval of its own in the history."""

RULES: Final = "rules:\n  - {name: pallet in view, when: over, class: pallet, count: 0}\n"
TOOLBOX: Final = (sys.executable, "-m", "fleetsight")
GATEWAY, DETECTOR, DISTANCE, CLOUD = "gateway", "detector", "distance", "cloud"
WORLD, MONITOR, ROUTER, ROUTER_2 = "worldmodel", "monitor", "router", "router 2"
MASTER, SIMULATOR, POSTGRESQL = "ROS master", "simulator", "postgresql"
CENTRE: Final = "central"
"""The name in the certificate of all processes that are on no robot."""

ON_ROBOT: Final = frozenset({MASTER, SIMULATOR, GATEWAY, DISTANCE, CLOUD})


@dataclass(frozen=True, slots=True)
class Place:
    """Where the fleet runs. network: None where the robot shares this one. database: None for SQLite.

    pki: prefix of the certificates' files, None for links without; routers then have access rules, see `admit`. clock:
    see `benchmarks.chaos.clock`.
    """

    folder: Path
    network: Network | None = None
    database: Database | None = None
    pki: Path | None = None
    clock: Mapping[str, str] | None = None

    @property
    def access(self) -> Path:
        """The file of the access rules."""
        return self.folder / "access.json"

    def admit(self, *robots: str) -> None:
        """Write access rules for these robots and the centre."""
        roles = {CENTRE: ["monitor", "worldmodel", "detector", "operator", "router"]}
        rules = access_control(FleetFile.model_validate({"robots": robots, "roles": roles}))
        write_whole(self.access, json.dumps(rules).encode())


class System:
    """All processes of the fleet, by role."""

    def __init__(self, place: Place, stack: ExitStack) -> None:
        self.place = place
        self.ahead_ns = 0
        self.journal = Journal(place.folder / "journal")
        self.processes: dict[str, Process] = {}
        self._stack = stack
        self._held: dict[str, ExitStack] = {}
        self._workers = 0
        self._ports = free_ports(8)
        address = place.network.address if place.network is not None else "127.0.0.1"
        link = "tcp" if place.pki is None else "tls"
        self.endpoints = [f"{link}/{address}:{self._ports + number}" for number in range(2)]
        self._beside = f"tcp/127.0.0.1:{self._ports + 2}"
        self._master = f"http://127.0.0.1:{self._ports + 3}"
        self.disk = place.folder / DISK
        history = f"sqlite:///{self.disk / 'history.db'}"
        self.history = place.database.url if place.database is not None else history
        self.store = Store(self.history)
        (place.folder / "rules.yaml").write_text(RULES, encoding="utf-8")
        (place.folder / "boot_id").write_text("elsewhere", encoding="ascii")
        self._commands: Mapping[str, Callable[[], Sequence[str]]] = {
            ROUTER: lambda: self._router(0),
            ROUTER_2: lambda: self._router(1),
            **({POSTGRESQL: place.database.command} if place.database is not None else {}),
            **({MASTER: self._master_command} if Path(ROSMASTER).exists() else {}),
            SIMULATOR: self._simulator,
            GATEWAY: self._gateway,
            DISTANCE: lambda: self._at_robot(DISTANCE),
            CLOUD: lambda: self._at_robot(CLOUD),
            DETECTOR: self._detector,
            WORLD: lambda: [*TOOLBOX, WORLD, *self._joining(), "--state", str(self.disk / "world")],
            MONITOR: self._monitor,
        }
        for role in self._commands:
            self._held[role] = stack.enter_context(ExitStack())

    @property
    def roles(self) -> Sequence[str]:
        """The roles that there are, in the order in which they are started."""
        return list(self._commands)

    def now_ns(self) -> int:
        """Return what the fleet's clocks show."""
        return time.time_ns() + self.ahead_ns

    def start(self, role: str) -> None:
        """Start a process. From the main thread alone: it ends with the thread."""
        command = [*self._prefix(role), *self._commands[role]()]
        self.processes[role] = self._held[role].enter_context(running(command))

    def kill(self, role: str) -> None:
        """End a process as a crash would."""
        self.processes.pop(role).kill()
        self._held[role].close()

    def end(self, role: str) -> None:
        """End a process in order."""
        self.processes.pop(role)
        self._held[role].close()

    def stop(self, role: str) -> None:
        """Let a process, and those that it made, stand still."""
        for process in self._family(role):
            process.suspend()

    def go_on(self, role: str) -> None:
        """Let them run on."""
        for process in self._family(role):
            process.resume()

    def pids(self) -> dict[str, int]:
        """Return the process of each role."""
        return {role: process.pid for role, process in self.processes.items()}

    def check(self) -> None:
        """Raise PeerError if a process ended by itself."""
        for process in self.processes.values():
            if not process.runs():
                raise PeerError(process.last_words())

    def last_words(self) -> str:
        """Return the ends of what all processes said."""
        return "\n".join(process.last_words() for process in self.processes.values())

    def bus_settings(self, *, name: str = CENTRE) -> BusSettings:
        """Return the settings of a session at the centre."""
        return BusSettings.model_validate({"connect": [self.endpoints[0]], "shared_memory": False, **self._tls(name)})

    def _family(self, role: str) -> list[psutil.Process]:
        process = psutil.Process(self.processes[role].pid)
        return [process, *process.children(recursive=True)]

    def _prefix(self, role: str) -> list[str]:
        network, clock = self.place.network, self.place.clock
        there = network.prefix if network is not None and role in ON_ROBOT else []
        stepped = ["env", *(f"{name}={value}" for name, value in clock.items())] if clock and role != POSTGRESQL else []
        return [*there, "setpriv", "--pdeathsig", "TERM", *stepped]

    def _tls(self, name: str) -> dict[str, str]:
        return {} if self.place.pki is None else {"tls": str(self.place.pki / name)}

    def _joining(self, name: str = CENTRE) -> list[str]:
        tls = [part for value in self._tls(name).values() for part in ("--tls", value)]
        return ["--connect", self.endpoints[0], "--no-shared-memory", *tls]

    def _router(self, number: int) -> list[str]:
        connect = self.endpoints[:number]
        own = {
            "mode": "router",
            "listen": [self.endpoints[number]],
            "connect": connect,
            "shared_memory": False,
            "insecure": True,
        }
        rules = {} if self.place.pki is None else {"access": str(self.place.access)}
        settings = BusSettings.model_validate({**own, **rules, **self._tls(CENTRE)})
        return [sys.executable, "-m", "benchmarks.chaos.router", settings.model_dump_json(exclude_unset=True)]

    def _master_command(self) -> list[str]:
        where = [f"ROS_MASTER_URI={self._master}", "ROS_IP=127.0.0.1"]
        return ["env", *where, ROSMASTER, "--core", "-p", self._master.rpartition(":")[2]]

    def _simulator(self) -> list[str]:
        real = MASTER in self._commands
        port = self._master.rpartition(":")[2]
        master = ["--ros-master", self._master] if real else ["--master-port", port]
        what = ["--prerender", "--streams", "color,depth,points", "--hz", str(HZ), "--frames", str(FRAMES)]
        return [*TOOLBOX, "simulate", *master, "--ros-host", "127.0.0.1", *what]

    def _gateway(self) -> list[str]:
        ros = ["--ros-master", self._master, "--ros-host", "127.0.0.1"]
        both = ["--connect", ",".join(self.endpoints), "--listen", self._beside, "--no-shared-memory"]
        tls = [part for value in self._tls(FRONT.robot).values() for part in ("--tls", value)]
        return [*TOOLBOX, GATEWAY, "--robot", FRONT.robot, *ros, *both, *tls, "--uplink-mbit", str(UPLINK_MBIT)]

    def _at_robot(self, service: str) -> list[str]:
        return [*TOOLBOX, service, "--robots", FRONT.robot, "--connect", self._beside, "--no-shared-memory"]

    def _detector(self) -> list[str]:
        self._workers += 1
        folder = self.place.folder
        name, files = f"{CENTRE}-{self._workers}", (str(folder / "journal"), str(FRAME_MS), str(folder / "boot_id"))
        settings = self.bus_settings().model_dump_json(exclude_unset=True)
        return [sys.executable, "-m", "benchmarks.chaos.worker", settings, name, *files]

    def _monitor(self) -> list[str]:
        rules = ["--rules", str(self.place.folder / "rules.yaml")]
        web = ["--web-port", str(self._ports + 4)]
        where = ["--mode", "client", *self._joining(), "--history", self.history]
        return [*TOOLBOX, MONITOR, *where, *rules, *web, *LISTS]


@asynccontextmanager
async def fleet(place: Place) -> AsyncIterator[tuple[System, Observer]]:
    """Start everything; end it on leaving."""
    async with AsyncExitStack() as stack:
        processes = stack.enter_context(ExitStack())
        system = System(place, processes)
        for role in system.roles:
            system.start(role)
            if role == POSTGRESQL:
                await answering(place.database)
        bus = await stack.enter_async_context(open_bus(system.bus_settings()))
        observer = await stack.enter_async_context(Observer(bus))
        stack.callback(_end_together, system)
        yield system, observer


def _end_together(system: System) -> None:
    """Ask all to end at once, so that nobody waits for them one by one."""
    for role, process in system.processes.items():
        if process.runs():
            system.go_on(role)
            psutil.Process(process.pid).terminate()


async def answering(database: Database | None) -> None:
    """Wait until the database answers."""
    async with asyncio.timeout(60):
        while database is not None and not await asyncio.to_thread(database.answers):  # noqa: ASYNC110
            await asyncio.sleep(0.05)
