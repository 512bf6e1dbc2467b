"""A monitor's alerting on a bus, and what robots and the store get of it."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from bus import QUEUE, Bus
from bus.fake import FakeNetwork
from schemas import codec
from schemas.alerts import Action, Alert, AlertState
from schemas.keys import RobotStreamKey
from services.monitor.alerting.alerting import OFFER_S, Alerting
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.rules.engine import MAX_SUBJECTS
from services.monitor.rules.rule_file import RuleFile
from tests.services.monitor.alerting.hearing import hears
from tests.services.monitor.inventory.seeing import FRONT, S, seen

RULES = """
rules:
  - {name: a pallet, when: appears, class: pallet, action: {name: pick_up, payload: "{class} at {robot}/{camera}"}}
  - {name: too near, when: nearer, class: box, than_m: 2, severity: critical}
  - {name: lost, when: silent}
"""


class Rig:
    """A monitor's alerts on a bus, and what robots get of them."""

    def __init__(self, alerting: Alerting, rules: RuleFile, inventory: Inventory, theirs: Bus) -> None:
        self.alerting = alerting
        self.rules = rules
        self.inventory = inventory
        self.theirs = theirs
        self.kept: list[Alert] = []
        self.leads = True
        self._seq = 0

    def see(self, *, ago_s: float = 0.0, **counts: int) -> None:
        """Take a class list of some time ago."""
        self._seq += 1
        at_ns = time.time_ns() - round(ago_s * S)
        self.alerting.take(self.inventory.see(seen(self._seq, counts), at_ns) or ())

    def states(self) -> list[tuple[str, AlertState]]:
        return [(each.rule, each.state) for each in self.kept]


def ahead(robot: str, ours_ns: int) -> int:
    """Return what a robot's clock shows."""
    return ours_ns + (S if robot == "r1" else 0)


@asynccontextmanager
async def rigged(
    tmp_path: Path,
    offer_s: float = OFFER_S,
    most_subjects: int = MAX_SUBJECTS,
    text: str = RULES,
    appear: tuple[int, int] = (1, 0),
) -> AsyncIterator[Rig]:
    path = tmp_path / "rules.yaml"
    path.write_text(text, encoding="utf-8")
    rules = RuleFile(path)
    await rules.load()
    inventory = Inventory(TrustLimits(Debounce(*appear, 1, 0)))
    alerting = Alerting(
        rules, inventory, hears(), robot_ns=ahead, settle_s=0, offer_s=offer_s, most_subjects=most_subjects
    )
    network = FakeNetwork()
    async with network.open_bus() as ours, network.open_bus() as theirs:
        made = Rig(alerting, rules, inventory, theirs)
        inventory.robot_presence("r1", alive=True)
        inventory.camera_presence(FRONT, alive=True)
        alerting.lead(())
        running = asyncio.create_task(alerting.run(ours, keep=made.kept.append, leads=lambda: made.leads))
        try:
            yield made
        finally:
            running.cancel()
            await asyncio.wait([running])


@asynccontextmanager
async def received(bus: Bus, stream: str, schema: type[Alert] | type[Action]) -> AsyncIterator[list[Alert | Action]]:
    """Collect what comes to robot r1."""
    found: list[Alert | Action] = []
    subscribed = asyncio.Event()

    async def collect() -> None:
        async with bus.subscribe(str(RobotStreamKey("r1", stream)), QUEUE(100), history=False) as samples:
            subscribed.set()
            async for sample in samples:
                found.append(codec.decode(schema, sample.payload, sample.encoding))  # noqa: PERF401 - as they come

    collecting = asyncio.create_task(collect())
    try:
        await subscribed.wait()
        yield found
    finally:
        collecting.cancel()
        await asyncio.wait([collecting])
