"""Runs a model: threads prepare images and read objects while the engine computes the next batch."""

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.header import MAX_LABEL
from schemas.image import ImageFrame
from schemas.tuning import Tuning
from services.detector.frame_counts import FAILED, MALFORMED
from services.detector.model import (
    NO_MASKS,
    NO_MASKS_OF_POSES,
    DetectedObjects,
    Failed,
    ModelError,
    Outcome,
    Request,
    first_line,
)
from services.detector.pixels import ImageDecodeError, to_bgr
from services.detector.runtime.candidates import Candidates
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.engine import Engine, OutOfMemoryError
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.model_file import DETECTION, Head, Task
from services.detector.runtime.overlap import difference
from services.detector.runtime.postprocess import Output, OutputError, objects
from services.detector.runtime.refinement.refiner import CloseUps, Refined, Refiner, close_ups

ANYTHING: Final = Criteria(confidence=0, max_detections=1)
"""However unsure: every number of the output is looked at."""


def prove(
    engine: Engine,
    blank: NDArray[np.uint8],
    names: Mapping[int, str],
    stride: int,
    *,
    head: Head = "nms",
    task: Task = DETECTION,
) -> None:
    """Compute an empty image, 1 x height x width x RGB, and read it like any other; names to task: the model's.

    Raises:
        OutputError: nothing can be read off the output. Any other error is the engine's: it does not work.
    """
    (output,) = engine.run(blank)
    height, width = blank.shape[1:3]
    as_it_is = Letterbox.fit(height, width, max(height, width), stride)
    objects(output, as_it_is, ANYTHING, names, masks=True, head=head, task=task)


log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts about a model. names: of its classes, by label. longest: longer side of its input in pixels.

    head, task: how objects are read off its output, and what they have. fixed: height and width of the only input that
    it takes, if so.
    """

    name: str
    runtime: str
    names: Mapping[int, str]
    task: Task
    longest: int
    stride: int
    head: Head = "nms"
    fixed: tuple[int, int] | None = None

    def letterbox(self, height: int, width: int) -> Letterbox:
        """Return how an image of this size is fitted into the model's input."""
        if self.task.kind == "classify":
            side = self.longest + -self.longest % self.stride
            return Letterbox.crop(height, width, self.fixed or (side, side))
        stretched = self.head == "rt-detr"
        return Letterbox.fit(height, width, self.longest, self.stride, stretched=stretched, fixed=self.fixed)

    def blank(self) -> NDArray[np.uint8]:
        """Return an empty image of 640 x 480 in the model's input, 1 x height x width x RGB; see `prove`."""
        return np.zeros((1, *self.letterbox(480, 640).shape, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class _Prepared:
    """An image in the model's input."""

    index: int
    letterbox: Letterbox
    pixels: NDArray[np.uint8]
    took_ns: int


class Pipeline:
    """A model behind the `Model` protocol.

    blank: an empty image that the engine has proved itself with, see `prove`; where it no longer can, it is of no more
    use. reference: what the engine's first images are checked against, where that is another one. refiner: of the
    masks, where there is one.
    """

    def __init__(
        self,
        facts: Facts,
        engine: Engine,
        criteria: Criteria,
        *,
        blank: NDArray[np.uint8],
        reference: Engine | None = None,
        refiner: Refiner | None = None,
        max_batch: int = 1,
        in_flight: int = 2,
    ) -> None:
        self.name = facts.name[:MAX_LABEL]
        self.runtime = facts.runtime
        self.max_batch = max_batch
        self.in_flight = in_flight
        self.facts = facts
        self.segments = facts.task.has_masks
        silent = NO_MASKS_OF_POSES if facts.task.kind == "pose" else NO_MASKS
        self.remarks: tuple[str, ...] = () if self.segments else (f"{facts.name} has no masks: {silent}",)
        self._engine = engine
        self._blank = blank
        self._reference = reference
        self._refiner = refiner
        self._leaves_coarse = False
        self._stages = ThreadPoolExecutor(in_flight, thread_name_prefix="images")
        self._computing = ThreadPoolExecutor(1, thread_name_prefix="model")
        self._last: asyncio.Future[None] | None = None
        self._criteria = criteria

    @property
    def tuning(self) -> Tuning:
        """See `Model.tuning`."""
        return self._criteria.tuning

    @property
    def classes(self) -> tuple[str, ...]:
        """See `Model.classes`."""
        names = self._criteria.classes or dict.fromkeys(self.facts.names.values())
        return tuple(name[:MAX_LABEL] for name in names)

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        self._criteria = self._criteria.tuned(tuning, self.facts.names)

    def close(self) -> None:
        """See `Model.close`."""
        self._stages.shutdown(wait=False, cancel_futures=True)
        self._computing.shutdown(wait=False, cancel_futures=True)

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        before, ended = self._last, asyncio.get_running_loop().create_future()
        self._last = ended
        try:
            found = await asyncio.get_running_loop().run_in_executor(self._stages, self.run, batch)
            if before is not None and not before.done():
                await asyncio.wait([before])
            return found
        finally:
            if before is None or before.done():
                ended.set_result(None)
            else:  # cancelled: who comes next waits for who came before
                before.add_done_callback(lambda _: ended.set_result(None))

    def run(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """Run `infer` on this thread, except for the engine's part; safe from several threads at once."""
        outcomes: dict[int, Outcome] = {}
        by_shape: defaultdict[tuple[int, int], list[_Prepared]] = defaultdict(list)
        for index, request in enumerate(batch):
            prepared = self._prepare(index, request.frame)
            if isinstance(prepared, Failed):
                outcomes[index] = prepared
            else:
                by_shape[prepared.letterbox.shape].append(prepared)
        for images in by_shape.values():
            for prepared, output, model_ns in self._computed(images):
                masks = batch[prepared.index].masks and self.segments
                outcomes[prepared.index] = self._read_off(prepared, output, model_ns, masks=masks)
        return [outcomes[index] for index in range(len(batch))]

    def _prepare(self, index: int, frame: ImageFrame) -> _Prepared | Failed:
        began_ns = time.perf_counter_ns()
        try:
            letterbox = self.facts.letterbox(frame.height, frame.width)
            pixels = np.empty((*letterbox.shape, 3), np.uint8)
            letterbox.apply(to_bgr(frame), pixels)
        except ImageDecodeError as error:
            return Failed(MALFORMED, error)
        except Exception as error:  # noqa: BLE001 - whatever is wrong with an image, it fails alone
            return Failed(FAILED, error)
        return _Prepared(index, letterbox, pixels, time.perf_counter_ns() - began_ns)

    def _computed(self, images: list[_Prepared]) -> list[tuple[_Prepared, Output | Exception, int]]:
        """Compute images of one shape; if the batch fails, one by one."""
        batch = images[0].pixels[None] if len(images) == 1 else np.stack([each.pixels for each in images])
        try:
            outputs, took_ns = self._computing.submit(self._compute, batch).result()
        except OutOfMemoryError as error:
            if len(images) == 1:
                size = "x".join(map(str, images[0].letterbox.shape[::-1]))
                raise ModelError(f"{self.name}: no memory for even one image of {size}: {error}") from error
            self.max_batch = max(1, len(images) // 2)
            log.warning("no memory for %d images at once; from now on at most %d", len(images), self.max_batch)
            middle = len(images) // 2
            return [*self._computed(images[:middle]), *self._computed(images[middle:])]
        except Exception as error:  # noqa: BLE001 - it fails alone, as above
            if len(images) == 1:
                self._prove()
                return [(images[0], error, 0)]
            return [result for each in images for result in self._computed([each])]
        return [(each, output, took_ns) for each, output in zip(images, outputs, strict=True)]

    def _prove(self) -> None:
        """Raise ModelError unless the engine still works: after an error, a GPU computes nothing or nonsense."""
        try:
            facts = self.facts
            proof = partial(prove, self._engine, self._blank, facts.names, facts.stride)
            self._computing.submit(proof, head=facts.head, task=facts.task).result()
        except Exception as error:
            raise ModelError(f"{self.name} works no longer: {first_line(error)}") from error

    def _compute(self, batch: NDArray[np.uint8]) -> tuple[list[Output], int]:
        """Run the engine, on its own thread."""
        began_ns = time.perf_counter_ns()
        outputs = self._engine.run(batch)
        took_ns = time.perf_counter_ns() - began_ns
        reference, self._reference = self._reference, None
        if reference is not None:
            self._check(batch, outputs[0], reference)
        return outputs, took_ns

    def _check(self, batch: NDArray[np.uint8], ours: Output, reference: Engine) -> None:
        """Add a remark if the engine's results differ from the reference's, or cannot be checked."""
        try:
            differing = self._difference(batch, ours, reference.run(batch)[0])
            found = None if differing is None else f"differs from torch: {differing}"
        except Exception as error:  # noqa: BLE001 - the image has its answer whatever becomes of this
            found = f"cannot be checked against torch: {first_line(error)}"
        if found is not None:
            self._remark(f"{self.name} under {self.facts.runtime} {found}")

    def _remark(self, remark: str) -> None:
        log.warning("%s", remark)
        self.remarks = (*self.remarks, remark)

    def _difference(self, batch: NDArray[np.uint8], ours: Output, theirs: Output) -> str | None:
        facts, (height, width) = self.facts, batch.shape[1:3]
        as_it_is = Letterbox.fit(height, width, max(height, width), facts.stride)
        here, there = (
            objects(each, as_it_is, self._criteria, facts.names, masks=False, head=facts.head, task=facts.task)
            for each in (ours, theirs)
        )
        return difference(here, there, self._criteria.greatest_score)

    def _read_off(self, prepared: _Prepared, output: Output | Exception, model_ns: int, *, masks: bool) -> Outcome:
        began_ns = time.perf_counter_ns()
        try:
            if isinstance(output, Exception):
                return Failed(FAILED, output)
            refine = None if self._refiner is None else partial(self._refined, self._refiner, prepared.pixels)
            facts = self.facts
            about = (prepared.letterbox, self._criteria, facts.names)
            found = objects(output, *about, masks=masks, refine=refine, head=facts.head, task=facts.task)
        except OutputError as error:
            self._prove()
            return Failed(FAILED, error)
        except Exception as error:  # noqa: BLE001 - it fails alone, as above
            return Failed(FAILED, error)
        after_ns = time.perf_counter_ns() - began_ns
        return DetectedObjects(found, {"prepare": prepared.took_ns, "model": model_ns, "postprocess": after_ns})

    def _refined(
        self, refiner: Refiner, image: NDArray[np.uint8], found: Candidates, prototypes: NDArray[np.float32]
    ) -> tuple[CloseUps, Refined] | None:
        """Refine masks. The refiner takes turns with the engine: each uses all processors."""
        seen = close_ups(image, found, prototypes)
        try:
            refined = self._computing.submit(refiner.run, seen).result()
            if not (np.isfinite(refined.odds).all() and np.isfinite(refined.qualities).all()):
                raise ValueError("what is not a number")  # noqa: TRY301 - as if it had said so itself
        except CancelledError:  # closed
            raise
        except Exception as error:  # noqa: BLE001 - what the model found is no worse for it
            self._remark_unrefined(error)
            return None
        return seen, refined

    def _remark_unrefined(self, error: Exception) -> None:
        """Log the failure once: the next images will hardly fare better."""
        if not self._leaves_coarse:
            self._leaves_coarse = True
            self._remark(f"{self.name} leaves masks coarse where refining them fails: {first_line(error)}")
