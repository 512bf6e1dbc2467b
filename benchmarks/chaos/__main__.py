"""How hard a fleet is to kill: real processes, and faults one after the other, in about ten minutes.

    faults           one entry for each, in the order of the run
      recovered_s    from the end of the fault until class lists, distances and object clouds of new frames come, the
                     world model has new views, a new class list is in the monitor's history, and the monitor answers;
                     null if not within a minute. A fault ends when the process is started again (3 s after SIGKILL, as
                     the systemd units do), goes on, or the link, the disk or the certificate is as before; roaming and
                     steps of the clock end as they begin
      lost           class lists that a worker had handed to its bus and that the history has not, and alerts that
                     class lists gave cause for and that it has not. Frames that no worker saw are no lost lists
      passed_alerts  how many of the lost alerts, at most, had a cause that came and went during the fault, so that no
                     monitor looked at what was in view while it held
      doubled        class lists that the history has twice, and alerts raised twice for one cause
      stuck_alerts   alerts that are still open although their cause is over, or the other way round
      frames         images that gateways received: inferred, dropped by whom and why, or never come to a worker, as
                     the counters of both say (of a killed process those of up to a second before); of `unattributed`
                     ones nobody says anything
      monitor_said   what the monitor told of its problems meanwhile
      rss_growth_mb, files_growth   of the process that grew most, of those that lived through the fault
    fleets           of each fleet, at its end: resident MiB and open files of every role
    age_p99_ms       of class lists on a link of 2 Mbit/s while images are wanted, from the gateway to the centre

Real are all processes, links, the history and its database. The detector is a real worker whose model is a stand-in:
it gives each class list a class of its own, so that each one is an interval of its own in the history. One robot with
one camera of 4 images a second; its link to the centre is a TUN device whose packets pass through a process that delays
and loses them, in network namespaces. Without root there are no faults of the network, and no full disk.
"""

import asyncio
import itertools
import os
import signal
import sys
import tempfile
import time
from argparse import ArgumentTypeError, Namespace
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.chaos import clock, database, resources
from benchmarks.chaos.faults import THIN, Fault, Needs, named
from benchmarks.chaos.network import Network, enter_namespace, has_namespaces, is_apart, mount_disk, unmount_disk
from benchmarks.chaos.observer import FRONT
from benchmarks.chaos.scenario import Scenario
from benchmarks.chaos.system import CENTRE, DISK, MASTER, POSTGRESQL, Place, fleet
from benchmarks.gateway.processes import ROSMASTER, PeerError
from benchmarks.machine import machine, versions
from benchmarks.monitor.__main__ import causes
from benchmarks.progress import note
from benchmarks.targets import Targets, at_least, at_most
from services.access.authority import Authority
from services.monitor.history.state import HistoryError

MODULE: Final = "benchmarks.chaos"
DISK_MIB: Final = 256
RECOVERED_S: Final = 5.0
AGE_MS: Final = 300.0
UNATTRIBUTED: Final = 2
"""Images of a fault that a gateway had received and not yet forwarded or left out when it was asked."""

FILES: Final = 2
"""Open files that a process may have more after a fault: a link to another router is one."""

MEMORY_MB: Final = 50.0
"""Memory that a process may have more after a fault: images and points that it keeps for others, within its limits."""

FAULTS: Final = 20
"""How many there are to be."""


def main() -> None:
    """Measure and print."""
    parser = parser_of(MODULE, __doc__)
    known = ", ".join(fault.name for fault in named(())).replace("%", "%%")
    parser.add_argument("--faults", type=_faults, default=named(()), help=f"which, by commas: {known} (default: all)")
    parser.add_argument("--strict", action="store_true", help="exit with 1 if a target is missed or a fault left out")
    parser.add_argument("--minutes", type=float, default=0.0, help="repeat them for so long (default: once)")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    if has_namespaces():
        enter_namespace(MODULE, sys.argv[1:])
    measured = asyncio.run(measure(arguments))
    show(measured, as_json=arguments.json)
    missed = [name for name, target in measured["targets"].items() if not target["met"]]
    if arguments.strict and (missed or measured["left_out"]):
        sys.exit(f"missed: {', '.join(missed) or 'nothing'}; left out: {', '.join(measured['left_out']) or 'nothing'}")


def _faults(text: str) -> list[Fault]:
    try:
        return named(name.strip() for name in text.split(",") if name.strip())
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from error


async def measure(arguments: Namespace) -> dict[str, Any]:
    """Do everything."""
    load, until_s = os.getloadavg()[0], time.monotonic() + arguments.minutes * 60
    wanted, left_out = possible(arguments.faults)
    found: list[dict[str, Any]] = []
    fleets: list[dict[str, Any]] = []
    for round_ in itertools.count(1):
        for needs, of_kind in itertools.groupby(wanted, key=_kind):
            found += [{**each, "round": round_} for each in await suffered(needs, list(of_kind), fleets)]
        if time.monotonic() > until_s:
            break
    return {
        "targets": targets(found),
        **summary(found),
        "faults": found,
        "fleets": fleets,
        "left_out": left_out,
        "stands_in": {"detector": "a real worker process with a stand-in model that numbers class lists"},
        "load_average": {"before": round(load, 1), "after": round(os.getloadavg()[0], 1)},
        "machine": machine(),
        "versions": versions(["eclipse-zenoh"]),
    }


def possible(faults: Sequence[Fault]) -> tuple[list[Fault], dict[str, str]]:
    """Return the faults that can be had here, and why the others cannot."""
    missing = {
        Needs.NETWORK: None if is_apart() else "it takes root, iproute2, util-linux and TUN devices",
        Needs.DISK: None if is_apart() else "it takes root",
        Needs.CLOCK: None if clock.compiler() else "it takes a C compiler",
    }
    roles = {
        POSTGRESQL: None if database.programs() else "it takes Debian's PostgreSQL",
        MASTER: None if Path(ROSMASTER).exists() else "it takes Debian's rosmaster",
    }
    reasons = {fault.name: missing.get(fault.needs) or roles.get(fault.role) for fault in faults}
    return [fault for fault in faults if not reasons[fault.name]], {name: why for name, why in reasons.items() if why}


def _kind(fault: Fault) -> Needs:
    """Return the kind of fleet that a fault takes: processes, network and disk share one."""
    return fault.needs if fault.needs in (Needs.CLOCK, Needs.CERTIFICATES) else Needs.NOTHING


async def suffered(needs: Needs, faults: Sequence[Fault], fleets: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Have faults of one kind on one fleet, or on a new one after each from which it did not recover.

    fleets: gets what each fleet's processes took at the end.
    """
    found: list[dict[str, Any]] = []
    while len(found) < len(faults):
        note(f"a fleet with {needs}")
        try:
            async with place(needs) as where, fleet(where) as (system, observer):
                scenario = Scenario(system, observer)
                for fault in faults[len(found) :]:
                    found.append(await scenario.suffer(fault))
                    note(_line(found[-1]))
                    if found[-1]["recovered_s"] is None:
                        break
                uses = resources.uses(system.pids())
                fleets.append({role: [round(of.rss / 2**20, 1), of.files] for role, of in uses.items()})
        except* (PeerError, HistoryError) as failed:
            name = faults[len(found)].name
            found.append({"name": name, "recovered_s": None, "lost": None, "doubled": None, "failed": causes(failed)})
            note(f"{name}: {found[-1]['failed']}")
    return found


def _line(found: dict[str, Any]) -> str:
    names = ("recovered_s", "lost", "doubled", "stuck_alerts", "lists", "alerts", "rss_growth_mb", "files_growth")
    return f"{found['name']}: " + ", ".join(f"{name} {found[name]}" for name in names)


@asynccontextmanager
async def place(needs: Needs) -> AsyncIterator[Place]:
    """Make what a fleet of a kind needs."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fleetsight-chaos-")))
        folder.chmod(0o755)  # noqa: ASYNC240 - nothing else runs yet
        network, disk = None, folder / DISK
        disk.mkdir()
        if is_apart():
            mount_disk(disk, DISK_MIB)
            stack.callback(unmount_disk, disk)
            network = Network(stack)
            await network.open()
        data = None
        if database.programs() is not None:
            (disk / "postgresql").mkdir()
            data = await asyncio.to_thread(database.Database, disk / "postgresql")
        pki, stepped = None, None
        if needs is Needs.CERTIFICATES:
            pki = folder / "pki"
            make_certificates(pki, network)
        if needs is Needs.CLOCK:
            stepped = await asyncio.to_thread(clock.make, folder)
        where = Place(folder, network, data, pki, stepped)
        if pki is not None:
            where.admit(FRONT.robot)
        yield where


def make_certificates(folder: Path, network: Network | None) -> None:
    """Make the certificates of a fleet."""
    authority = Authority(folder)
    authority.make()
    authority.issue(CENTRE, [network.address] if network is not None else [], 1)
    authority.issue(FRONT.robot, (), 1)


def summary(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the worst of all faults."""
    recovered = [each["recovered_s"] for each in found]
    thin = [each["age_p99_ms"] for each in found if each["name"] == THIN and each.get("age_p99_ms") is not None]
    return {
        "number": len({each["name"] for each in found}),
        "recovered_s": None if None in recovered else max(recovered, default=None),
        "lost": _sum(found, "lost"),
        "doubled": _sum(found, "doubled"),
        "stuck_alerts": _sum(found, "stuck_alerts"),
        "age_p99_ms": max(thin, default=None),
        "unattributed": max((abs(each["frames"]["unattributed"]) for each in found if "frames" in each), default=None),
        "files_growth": max((each["files_growth"] for each in found if "files_growth" in each), default=None),
        "rss_growth_mb": max((each["rss_growth_mb"] for each in found if "rss_growth_mb" in each), default=None),
    }


def _sum(found: Sequence[dict[str, Any]], name: str) -> int | None:
    values = [each.get(name) for each in found]
    return None if None in values else sum(value for value in values if value is not None)


def targets(found: Sequence[dict[str, Any]]) -> Targets:
    """Return each target and whether it is met."""
    worst = summary(found)
    met = {**at_least(worst, "number", FAULTS), **at_most(worst, "recovered_s", RECOVERED_S)}
    for name in ("lost", "doubled", "stuck_alerts"):
        met |= at_most(worst, name, 0)
    return {
        **met,
        **at_most(worst, "age_p99_ms", AGE_MS),
        **at_most(worst, "unattributed", UNATTRIBUTED),
        **at_most(worst, "files_growth", FILES),
        **at_most(worst, "rss_growth_mb", MEMORY_MB),
    }


if __name__ == "__main__":
    main()
