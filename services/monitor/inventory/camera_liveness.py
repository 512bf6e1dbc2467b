"""Finds the live cameras without checking each camera that simply continues. Pure."""

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count, islice
from typing import Final

from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import MAX_NS, Inventory

AT_ONCE: Final = 500
PARTS: Final = 5
"""Limits the checks per call to a number, or this part of all cameras, so that no call takes long."""

Speaks = Callable[[CameraView, int], bool]
"""Whether a camera is live at a time; a live one stays so until `stale_ns` after its newest list, unless notified."""


class SpeakingCameras:
    """Tracks the live cameras of an inventory. A live camera is checked again when it could have fallen silent.

    speaks: whether a new one counts as speaking before it was looked at.
    """

    def __init__(self, inventory: Inventory, rule: Speaks, *, speaks: bool) -> None:
        self._inventory = inventory
        self._rule = rule
        self._new_speak = speaks
        self._known = 0
        self._silent: set[CameraView] = set()
        self._deadlines: list[tuple[int, int, CameraView]] = []
        self._waiting: set[CameraView] = set()
        self._numbers = count()
        self._now_ns = 0

    def advance(self, now_ns: int, told: Iterable[CameraView] = ()) -> list[CameraView]:
        """Return the cameras that became live or silent by `now_ns`. told: cameras to check in any case."""
        self._meet(list(islice(self._inventory.cameras(), self._known, None)), now_ns)
        looked_at = {*told, *self._due(now_ns)} - self._silent
        began = [view for view in self._silent if self._rule(view, now_ns)]
        ceased = [view for view in looked_at if not self._rule(view, now_ns)]
        self._silent.difference_update(began)
        self._silent.update(ceased)
        for view in (*began, *looked_at.difference(ceased)):
            newest_ns = min(view.last_ns, now_ns)  # after a clock was set back, earlier arrivals are in the future
            self._wait(view, max(now_ns, newest_ns + self._inventory.limits.stale_ns) + 1)
        return [*began, *ceased]

    def _meet(self, new: Sequence[CameraView], now_ns: int) -> None:
        self._known += len(new)
        if not self._new_speak:
            self._silent.update(new)
            return
        for view in new:
            self._wait(view, now_ns)

    def _due(self, now_ns: int) -> Iterator[CameraView]:
        """Take out the due cameras, in batches; all of them if the clock was set back."""
        was_set_back, self._now_ns = now_ns < self._now_ns, now_ns
        until_ns = MAX_NS if was_set_back else now_ns
        most = len(self._deadlines) if was_set_back else max(AT_ONCE, len(self._deadlines) // PARTS)
        while most and self._deadlines and self._deadlines[0][0] <= until_ns:
            most -= 1
            view = heapq.heappop(self._deadlines)[2]
            self._waiting.discard(view)
            yield view

    def _wait(self, view: CameraView, until_ns: int) -> None:
        if view not in self._waiting:
            self._waiting.add(view)
            heapq.heappush(self._deadlines, (until_ns, next(self._numbers), view))
