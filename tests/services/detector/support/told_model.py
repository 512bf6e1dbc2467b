"""A model that answers when it is told to."""

import asyncio
from collections.abc import Sequence

from schemas.detections import Detection
from schemas.tuning import Tuning
from services.detector.frame_counts import FAILED
from services.detector.model import DetectedObjects, Failed, ModelError, Outcome, Request

FATAL = 13


class ToldModel:
    """Answers each call when told to, or at once; fails on frames numbered FATAL. objects: found in every other one."""

    name = "told"
    runtime = ""
    segments = False
    remarks: tuple[str, ...] = ()
    tuning = Tuning()
    classes: tuple[str, ...] = ()

    def __init__(self, max_batch: int = 1, in_flight: int = 1, *, at_once: bool = False) -> None:
        self.max_batch = max_batch
        self.in_flight = in_flight
        self.calls: list[Sequence[Request]] = []
        self.answers: list[asyncio.Event] = []
        self.broken = False
        self.objects: list[Detection] = []
        self._at_once = at_once

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        self.tuning = tuning

    def close(self) -> None:
        """See `Model.close`."""

    def answer_at_once(self) -> None:
        """Answer the calls that wait and those to come."""
        self._at_once = True
        for answer in self.answers:
            answer.set()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        answer = asyncio.Event()
        self.calls.append(batch)
        self.answers.append(answer)
        if not self._at_once:
            await answer.wait()
        if self.broken:
            raise ModelError("it is broken")
        return [self._look_at(request) for request in batch]

    def _look_at(self, request: Request) -> Outcome:
        if request.frame.header.seq == FATAL:
            return Failed(FAILED, RuntimeError("fatal"))
        return DetectedObjects(self.objects, {"model": 7})
