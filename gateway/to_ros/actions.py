"""Which actions a robot still does: those that were sent just now, each once."""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from gateway.to_ros.done_actions import DoneActions
from gateway.to_ros.stream import NotNowError
from schemas import codec
from schemas.alerts import Action
from schemas.keys import RobotStreamKey

NS: Final = 1_000_000_000
MOST_AGE_NS: Final = 30 * NS
"""An action that took longer, over a link that was down, is no longer what somebody wants done."""

MOST_AHEAD_NS: Final = 5 * NS
CLOCK_ERROR_NS: Final = NS // 4
"""By how much the monitor's measurement of the robot's clock may be off."""

MOST_REMEMBERED: Final = 10_000

OLD: Final = "sent more than 30 s ago, or the clocks of sender and robot are apart"
EARLIER: Final = "sent before this gateway started"
AHEAD: Final = "sent in the future, so the clocks of sender and robot are apart"
MANY: Final = "more actions within 30 s than the gateway remembers"


class FreshActions:
    """Accepts each action once, within MOST_AGE_NS of its sending and not from before this process began.

    So one that is sent again later is refused, though it is no longer remembered, also after a restart. before: those
    done before, where that is kept: clocks that are set or apart may let one pass for sent later. wall_ns, steady_ns:
    the robot's clock, which may be set meanwhile, and one that never is.
    """

    def __init__(
        self,
        key: RobotStreamKey,
        before: DoneActions | None = None,
        wall_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._key = key
        self._before = before or DoneActions(None)
        self._wall_ns = wall_ns
        self._steady_ns = steady_ns
        self._began_ns = steady_ns()
        self._done: OrderedDict[str, int] = OrderedDict()

    def is_new(self, asked: Action) -> bool:
        """Return whether an action was not done yet.

        Raises:
            SchemaError: it is for another robot.
            NotNowError: it is not of now, or there are too many.
        """
        codec.check_robot(asked.robot, self._key)
        now_ns = self._steady_ns()
        age_ns = self._wall_ns() - (asked.robot_ns or asked.sent_ns)
        if age_ns > MOST_AGE_NS:
            raise NotNowError(OLD)
        if age_ns < -MOST_AHEAD_NS:
            raise NotNowError(AHEAD)
        if age_ns > now_ns - self._began_ns + CLOCK_ERROR_NS:
            raise NotNowError(EARLIER)
        self._forget(now_ns)
        if asked.id in self._done or asked.id in self._before:
            return False
        if len(self._done) >= MOST_REMEMBERED:
            raise NotNowError(MANY)
        return True

    def remember(self, asked: Action) -> None:
        """Note an action that was done."""
        self._done[asked.id] = self._steady_ns()
        self._before.add(asked.id)

    def _forget(self, now_ns: int) -> None:
        """Forget actions that are too old to be accepted again, whatever they say of when they were sent."""
        while self._done and next(iter(self._done.values())) < now_ns - MOST_AGE_NS - MOST_AHEAD_NS:
            self._done.popitem(last=False)
