"""A flooded worker and its gateways, in simulated time: most of what is sent is looked at, and while it is young.

The same of what a second opinion does not spare, where gateways send all since others ask for it.
"""

import heapq
import random
from dataclasses import dataclass, field

import pytest

from bus.sharing.pace import Pace, Totals
from gateway.to_bus.shaping.consumers import Allowance
from schemas.budget import RateBudget
from schemas.keys import CameraKey
from services.detector.frame_queue import FrameQueue, QueuedFrame
from services.worker.rate_limiter import RateLimiter
from tests.schemas.frames import image

CALL_S = 0.05
CAMERA_HZ = 10
MOST_HZ = 2.0
LIMIT_NS = 80_000_000
SECOND = 1_000_000_000


class Consumer:
    """What a worker asked for of one camera, and who thins the frames to that."""

    def __init__(self, spares: bool) -> None:  # noqa: FBT001 - one of two
        self._spares = spares
        self._allowance = Allowance()
        self._sparing = RateLimiter()
        self._asked = (MOST_HZ, 0)

    def ask(self, hz: float | None, wait_s: float, now_ns: int) -> None:
        """Take what the worker asks for."""
        budget = RateBudget(robot="r1", camera="c", consumer="w", stream="color", hz=hz, wait_s=wait_s)
        self._allowance.say(budget, now_ns)
        self._asked = (MOST_HZ if hz is None else min(MOST_HZ, hz), now_ns + round(wait_s * SECOND))

    def passes(self, now_ns: int) -> bool:
        """Return whether a frame gets to the frame_queue."""
        return self._sparing.passes(now_ns, *self._asked) if self._spares else self._allowance.passes(now_ns)


@dataclass(slots=True)
class Simulation:
    """Cameras with phases of their own, gateways that send what is asked for, one worker that takes CALL_S a frame.

    spares: gateways send all, and the worker, a second opinion, spares what it did not ask for.
    """

    count: int
    seed: int
    spares: bool = False
    sent: int = 0
    done: int = 0
    lost: int = 0
    busy_s: float = 0.0
    oldest_ns: int = 0
    frame_queue: FrameQueue = field(default_factory=FrameQueue)
    pace: Pace = field(default_factory=Pace)

    def run(self, seconds: float, measured_s: float) -> None:
        """Run for a while; count the end of it."""
        rng = random.Random(self.seed)  # noqa: S311 - no secret
        cameras = [CameraKey("r1", f"c{number}") for number in range(self.count)]
        asked = {camera: Consumer(self.spares) for camera in cameras}
        events: list[tuple[float, int, CameraKey | None]] = [(rng.random() / CAMERA_HZ, 1, key) for key in cameras]
        events.append((0.25, 2, None))
        heapq.heapify(events)
        free_s, before = 0.0, (0, 0, 0.0)
        while (now_s := events[0][0]) < seconds:
            _, kind, key = heapq.heappop(events)
            now_ns = round(now_s * SECOND)
            if kind == 1 and key is not None:
                heapq.heappush(events, (now_s + 1 / CAMERA_HZ, 1, key))
                if asked[key].passes(now_ns):
                    self.sent += 1
                    self.lost += self.frame_queue.post(key, QueuedFrame(image(), now_ns))
            elif kind == 2:
                heapq.heappush(events, (now_s + 0.25, 2, None))
                if self.pace.look(Totals(self.done, self.lost, self.busy_s), self.count, now_s):
                    self._ask(asked, now_ns)
            if now_s >= free_s:
                free_s = self._work(now_s, now_ns, rng)
                heapq.heappush(events, (free_s, 0, None))
            if now_s < seconds - measured_s:
                before = self.sent, self.done, self.busy_s
                self.oldest_ns = 0
        self.sent, self.done, self.busy_s = self.sent - before[0], self.done - before[1], self.busy_s - before[2]

    def _work(self, now_s: float, now_ns: int, rng: random.Random) -> float:
        self.lost += len(self.frame_queue.expire(now_ns, LIMIT_NS))
        for _, waiting in self.frame_queue.take(1):
            self.oldest_ns = max(self.oldest_ns, waiting.age_ns(now_ns))
            call_s = CALL_S + rng.random() * 0.004
            self.done, self.busy_s = self.done + 1, self.busy_s + call_s
            return now_s + call_s
        return now_s + 0.001

    def _ask(self, asked: dict[CameraKey, Consumer], now_ns: int) -> None:
        limit = self.pace.limit_hz
        for turn, key in enumerate(self.frame_queue.by_turn(asked)):
            hz, wait_s = (None, 0.0) if limit is None else (limit / self.count, turn / limit)
            asked[key].ask(hz, wait_s, now_ns)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("count", [3, 5, 8, 14, 64])
def test_nine_in_ten_frames_are_used_and_the_worker_is_busy(count: int, seed: int) -> None:
    simulation = Simulation(count, seed)
    simulation.run(60, measured_s=30)
    assert simulation.done / simulation.sent >= 0.9
    assert simulation.busy_s >= 0.85 * 30
    assert simulation.oldest_ns <= LIMIT_NS


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("count", [8, 14, 64])
def test_a_second_opinion_that_gets_every_frame_looks_at_what_it_can(count: int, seed: int) -> None:
    simulation = Simulation(count, seed, spares=True)
    simulation.run(60, measured_s=30)
    assert simulation.done / simulation.sent >= 0.85
    assert simulation.busy_s >= 0.75 * 30
    assert simulation.oldest_ns <= LIMIT_NS


def test_a_worker_that_can_keep_up_is_sent_everything() -> None:
    simulation = Simulation(1, 1)
    simulation.run(20, measured_s=10)
    assert simulation.pace.limit_hz is None
    assert simulation.sent in {99, 100, 101}
    assert abs(simulation.done - simulation.sent) <= 1
