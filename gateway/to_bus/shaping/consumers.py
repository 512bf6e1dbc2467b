"""Tracks consumers of a robot's streams: whether all are on this machine, and the rates they can use."""

import ipaddress
import logging
import math
import re
import time
from asyncio import TaskGroup
from collections.abc import Callable, Iterable
from typing import Final

from bus import QUEUE, Bus, BusSettings, Presence, Sample
from schemas import codec, consumer_keys
from schemas.budget import RateBudget
from schemas.consumer_keys import Wanted
from schemas.errors import SchemaError
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey

MAX_BUDGETS: Final = 10_000

SECOND_NS: Final = 1_000_000_000

FEWEST_HZ: Final = 0.1
"""Lowest rate, in frames a second, to which consumers can bring a stream: no budget stops one, whoever sends it."""

VALID_NS: Final = 15 * SECOND_NS
"""Time for which a budget counts unless it is said again: consumers repeat theirs every 5 s."""

LATE: Final = 0.7
"""Fraction of an interval by which a frame may be late without delaying the next one."""


class Allowance:
    """The rate that one consumer can use. Times are nanoseconds of any one clock of this machine."""

    def __init__(self) -> None:
        self.hz = math.inf
        self._said_ns = 0
        self._due_ns = 0
        self._longest_ns = 0

    def say(self, budget: RateBudget, now_ns: int) -> None:
        """Set a consumer's rate, FEWEST_HZ or more; repeating it does not bring the next frame forward."""
        hz = math.inf if budget.hz is None else max(FEWEST_HZ, budget.hz)
        self._said_ns = now_ns
        if hz == self.hz and not budget.wait_s:
            return
        self.hz = hz
        self._longest_ns = round(min(budget.wait_s, 1 / FEWEST_HZ) * SECOND_NS)
        self._due_ns = now_ns + self._longest_ns

    def counts(self, now_ns: int) -> bool:
        """Whether it was said lately, also by a clock that was set."""
        return abs(now_ns - self._said_ns) <= VALID_NS

    def passes(self, now_ns: int) -> bool:
        """Return whether a frame that arrives now is sent."""
        if math.isinf(self.hz):
            return True
        if 0 < self._due_ns - now_ns <= self._longest_ns:  # a longer wait is impossible: the clock was set back
            return False
        turn_ns = round(SECOND_NS / self.hz)
        on_time_ns = self._due_ns if 0 <= now_ns - self._due_ns <= LATE * turn_ns else now_ns
        self._due_ns, self._longest_ns = on_time_ns + turn_ns, turn_ns
        return True


class Budgets:
    """Rates that consumers requested, valid for VALID_NS while they want the stream; at most MAX_BUDGETS, the newest.

    A word can come when its consumer's token has gone already, and is then forgotten only to make room.
    """

    def __init__(self) -> None:
        self._allowances: dict[tuple[SensorKey, str], Allowance] = {}

    def say(self, camera: CameraKey, budget: RateBudget, now_ns: int) -> None:
        """Set a consumer's rate for a camera.

        Raises:
            SchemaError: it is on another camera, or on no stream of it.
        """
        if (budget.robot, budget.camera) != (camera.robot, camera.camera):
            raise SchemaError(f"it is for {budget.robot}/{budget.camera}, the key says {camera}")
        if budget.stream not in set(Stream):
            raise SchemaError(f"no stream of a camera: {budget.stream[:80]!r}")
        of = StreamKey(camera, Stream(budget.stream)), budget.consumer
        allowance = self._allowances.pop(of, None) or Allowance()
        self._allowances[of] = allowance
        allowance.say(budget, now_ns)
        if len(self._allowances) > MAX_BUDGETS:
            del self._allowances[next(iter(self._allowances))]

    def forget(self, wanted: Wanted) -> None:
        """Forget the rate of a consumer that no longer wants a stream."""
        self._allowances.pop((wanted.key, wanted.consumer), None)

    def passes(self, key: StreamKey, consumers: Iterable[Wanted], now_ns: int) -> bool:
        """Return whether a frame is sent: whenever any consumer can use it.

        consumers: all that are known to want the stream. One that never said how much it can use can use all, and so
        can who is not known, if nobody is.
        """
        found = [self._allowances.get((key, each.consumer)) for each in consumers]
        counting = [each for each in found if each is not None and each.counts(now_ns)]
        if not counting or len(counting) < len(found):
            return True
        return max(counting, key=lambda each: each.hz).passes(now_ns)


MAX_CONSUMERS: Final = 10_000
BUDGETS_WAITING: Final = QUEUE(1_000, 8 << 20)

log = logging.getLogger(__name__)


HERE_AGAIN_S: Final = 6.0
"""Time, beside the link's lease, for which a stream whose last announced consumer has gone counts as this machine's, if
that was on it.

When the link to the fleet is lost and made again, the services beside the gateway stop wanting its streams, and soon
want them again. A frame may then come before their tokens do; as one for elsewhere, a point cloud would take a thin
uplink's budget of ten seconds. Streams that are not wanted stay subscribed on ROS for less than that, and a router that
the gateway moved to may say for as long as `bus.session.listening_client.SETTLED_S` takes that they are wanted.
"""


class Consumers:
    """Consumers of the robot's streams, from their tokens and budgets.

    clock_id: this machine's. near: whether what this process sends to one on the same machine stays on it. lease_s: the
    link's. steady_s: returns the seconds of a clock that is never set.
    """

    def __init__(
        self,
        robot: str,
        clock_id: str,
        *,
        near: bool,
        lease_s: float = BusSettings().lease_s,
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._robot = robot
        self._clock_id = clock_id
        self._near = near
        self._here_again_s = lease_s + HERE_AGAIN_S
        self._steady_s = steady_s
        self._here_until_s: dict[SensorKey, float] = {}
        self._elsewhere_until_s: dict[SensorKey, float] = {}
        self._known: dict[SensorKey, set[Wanted]] = {}
        self._count = 0
        self._budgets = Budgets()

    def passes(self, key: StreamKey, now_ns: int) -> bool:
        """Return whether a frame that arrives now is sent: not if it exceeds the rates of all consumers.

        now_ns: nanoseconds since the epoch.
        """
        known = self._known.get(key)
        return known is None or self._budgets.passes(key, known, now_ns)

    def all_here(self, key: SensorKey) -> bool:
        """Return whether the stream has, or had a moment ago, announced consumers, and all of them on this machine."""
        known = self._known.get(key)
        if not known:
            now_s = self._steady_s()
            elsewhere = now_s < self._elsewhere_until_s.get(key, 0.0)
            return self._near and not elsewhere and now_s < self._here_until_s.get(key, 0.0)
        return self._near and all(each.clock_id == self._clock_id for each in known)

    def note(self, presence: Presence) -> None:
        """Note that a consumer's token appeared or vanished."""
        try:
            wanted = consumer_keys.parse_wanted(presence.key)
        except SchemaError as error:
            log.warning("%s: consumer left out: %s", presence.key[:200], error)
            return
        known = self._known.setdefault(wanted.key, set())
        before = len(known)
        if not presence.alive:
            known.discard(wanted)
            self._budgets.forget(wanted)
        elif self._count < MAX_CONSUMERS:
            known.add(wanted)
        self._count += len(known) - before
        if len(known) < before:
            here = wanted.clock_id == self._clock_id
            self._remember(wanted.key, self._here_until_s if here else self._elsewhere_until_s)
        if not known:
            del self._known[wanted.key]

    def _remember(self, key: SensorKey, until_s: dict[SensorKey, float]) -> None:
        """Note that a consumer of a stream has gone."""
        now_s = self._steady_s()
        for each in [each for each, end_s in until_s.items() if end_s <= now_s]:
            del until_s[each]
        until_s[key] = now_s + self._here_again_s

    def note_budget(self, sample: Sample) -> None:
        """Note the rate that a consumer can use."""
        try:
            self._budgets.say(*_read_budget(sample), sample.received_ns)
        except SchemaError as error:
            log.warning("%s: budget left out: %s", sample.key[:200], error)

    async def follow(self, bus: Bus) -> None:
        """Follow consumers' tokens and budgets, forever."""
        async with TaskGroup() as group:
            group.create_task(self._follow_tokens(bus))
            group.create_task(self._follow_budgets(bus))

    async def _follow_tokens(self, bus: Bus) -> None:
        async with bus.watch(consumer_keys.every_wanted(self._robot), few=True) as watch:
            async for presence in watch:
                self.note(presence)

    async def _follow_budgets(self, bus: Bus) -> None:
        async with bus.subscribe(
            consumer_keys.every_budget(self._robot), BUDGETS_WAITING, history=False, few=True
        ) as budgets:
            async for sample in budgets:
                self.note_budget(sample)


def _read_budget(sample: Sample) -> tuple[CameraKey, RateBudget]:
    """Return a budget and its camera.

    Raises:
        SchemaError: it is none, or another consumer's than its key says.
    """
    budget = codec.decode(RateBudget, sample.payload, sample.encoding)
    camera, consumer = consumer_keys.parse_budget(sample.key)
    if budget.consumer != consumer:
        raise SchemaError(f"it is {budget.consumer}'s, the key says {consumer}")
    return camera, budget


def stays_near(settings: BusSettings) -> bool:
    """Return whether processes on this machine connect locally, not by way of a remote router."""
    return not settings.has_one_link or (bool(settings.connect) and all(map(_is_loopback, settings.connect)))


def _is_loopback(endpoint: str) -> bool:
    host = re.sub(r":\d+(?:[?#].*)?$", "", endpoint.partition("/")[2]).strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
