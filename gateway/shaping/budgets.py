"""How many frames of each stream its consumers can use, by what they say. Pure."""

import math
from collections.abc import Iterable
from typing import Final

from schemas.budget import RateBudget
from schemas.errors import SchemaError
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey, Wanted

MAX_BUDGETS: Final = 10_000

SECOND_NS: Final = 1_000_000_000

LATE: Final = 0.7
"""By how much of a turn a frame may come too late without putting off the next one."""


class Allowance:
    """The rate that one consumer can use. Times are nanoseconds of any one clock of this machine."""

    def __init__(self) -> None:
        self.hz = math.inf
        self._due_ns = 0
        self._longest_ns = 0

    def say(self, budget: RateBudget, now_ns: int) -> None:
        """Take a consumer's word; one that says nothing new puts no frame forward."""
        hz = math.inf if budget.hz is None else budget.hz
        if hz == self.hz and not budget.wait_s:
            return
        self.hz = hz
        self._longest_ns = round(budget.wait_s * SECOND_NS)
        self._due_ns = now_ns + self._longest_ns

    def passes(self, now_ns: int) -> bool:
        """Return whether a frame is sent that is here now."""
        if math.isinf(self.hz):
            return True
        if 0 < self._due_ns - now_ns <= self._longest_ns:  # a longer wait than there ever is: the clock was set back
            return False
        turn_ns = round(SECOND_NS / self.hz)
        on_time_ns = self._due_ns if 0 <= now_ns - self._due_ns <= LATE * turn_ns else now_ns
        self._due_ns, self._longest_ns = on_time_ns + turn_ns, turn_ns
        return True


class Budgets:
    """What consumers said. A word counts while its consumer wants the stream; the newest MAX_BUDGETS are remembered.

    A word can come when its consumer's token has gone already, and is then forgotten only to make room.
    """

    def __init__(self) -> None:
        self._allowances: dict[tuple[SensorKey, str], Allowance] = {}

    def say(self, camera: CameraKey, budget: RateBudget, now_ns: int) -> None:
        """Take a consumer's word on a camera.

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
        """Forget what a consumer said who no longer wants a stream."""
        self._allowances.pop((wanted.key, wanted.consumer), None)

    def passes(self, key: StreamKey, consumers: Iterable[Wanted], now_ns: int) -> bool:
        """Return whether a frame is sent: whenever the consumer that can use most has a use for it.

        consumers: all that are known to want the stream. One that never said how much it can use can use all, and so
        can who is not known, if nobody is.
        """
        found = [self._allowances.get((key, each.consumer)) for each in consumers]
        if not found or None in found:
            return True
        return max((each for each in found if each), key=lambda each: each.hz).passes(now_ns)
