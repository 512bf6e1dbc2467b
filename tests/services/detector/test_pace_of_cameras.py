"""A flooded worker and its gateways, in simulated time: most of what is sent is looked at, and while it is young."""

import heapq
import random
from dataclasses import dataclass, field

import pytest

from bus.sharing.pace import Pace, Totals
from gateway.shaping.budgets import Allowance
from schemas.budget import RateBudget
from schemas.keys import CameraKey
from services.detector.board import Board, Waiting
from tests.schemas.frames import image

CALL_S = 0.05
CAMERA_HZ = 10
LIMIT_NS = 80_000_000
SECOND = 1_000_000_000


@dataclass(slots=True)
class Simulation:
    """Cameras with phases of their own, gateways that send what is asked for, one worker that takes CALL_S a frame."""

    count: int
    seed: int
    sent: int = 0
    done: int = 0
    lost: int = 0
    busy_s: float = 0.0
    oldest_ns: int = 0
    board: Board = field(default_factory=Board)
    pace: Pace = field(default_factory=Pace)

    def run(self, seconds: float, measured_s: float) -> None:
        """Run for a while; count the end of it."""
        rng = random.Random(self.seed)  # noqa: S311 - no secret
        cameras = [CameraKey("r1", f"c{number}") for number in range(self.count)]
        asked = {camera: Allowance() for camera in cameras}
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
                    self.lost += self.board.post(key, Waiting(image(), now_ns))
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
        self.lost += len(self.board.expire(now_ns, LIMIT_NS))
        for _, waiting in self.board.take(1):
            self.oldest_ns = max(self.oldest_ns, waiting.age_ns(now_ns))
            call_s = CALL_S + rng.random() * 0.004
            self.done, self.busy_s = self.done + 1, self.busy_s + call_s
            return now_s + call_s
        return now_s + 0.001

    def _ask(self, asked: dict[CameraKey, Allowance], now_ns: int) -> None:
        limit = self.pace.limit_hz
        for turn, key in enumerate(self.board.by_turn(asked)):
            hz, wait_s = (None, 0.0) if limit is None else (limit / self.count, turn / limit)
            asked[key].say(
                RateBudget(robot="r1", camera=key.camera, consumer="w", stream="color", hz=hz, wait_s=wait_s), now_ns
            )


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("count", [3, 5, 8, 14, 64])
def test_nine_in_ten_frames_are_used_and_the_worker_is_busy(count: int, seed: int) -> None:
    simulation = Simulation(count, seed)
    simulation.run(60, measured_s=30)
    assert simulation.done / simulation.sent >= 0.9
    assert simulation.busy_s >= 0.85 * 30
    assert simulation.oldest_ns <= LIMIT_NS


def test_a_worker_that_can_keep_up_is_sent_everything() -> None:
    simulation = Simulation(1, 1)
    simulation.run(20, measured_s=10)
    assert simulation.pace.limit_hz is None
    assert simulation.sent in {99, 100, 101}
    assert abs(simulation.done - simulation.sent) <= 1
