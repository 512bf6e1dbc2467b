"""Loads a model that is ready to use, from settings."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.printing import printable
from schemas.tuning import Tuning
from services.detector.model import Model, ModelError, TuningError, first_line
from services.detector.pairing import PairedModel
from services.detector.runtime.choosing import INT8, batch_size
from services.detector.runtime.criteria import Criteria, listed, renamed
from services.detector.runtime.engine import BATCH_ON_GPU, RunningModel
from services.detector.runtime.exported_loading import running_export
from services.detector.runtime.exported_model import ExportedModel, read_exported
from services.detector.runtime.model_file import ModelFile, is_exported
from services.detector.runtime.offline import keep_offline, keep_torch_offline, set_environment
from services.detector.runtime.pipeline import Facts, Pipeline
from services.detector.runtime.refinement.refiner import Refiner
from services.detector.settings import LEAST_SIDE, MOST_SIDE, WEIGHTS_NEED, DetectorSettings, not_installed
from services.detector.tracking.confirmed_tracks import NEUTRAL, neutral_score
from services.detector.tracking.trackers import CameraTracker
from services.detector.tracking.tracks import Tracking

UNMEASURED: Final = {False: "torch", True: "onnx"}
"""Runtimes of weights and of exported models that work wherever such a model does."""

OF_WEIGHTS: Final = ("torch", "tensorrt")
"""Runtimes that run weights alone."""

log = logging.getLogger(__name__)


def load_all(settings: DetectorSettings, folder: Path, *, as_before: str | None = None) -> Model:
    """Load the model, and the one for boxes if there is one; see `load`. Both are read before either is exported.

    as_before: the runtime of an earlier model, instead of the requested one. A model without INT8 networks runs under
    the same library in single precision.
    """
    read = _read(settings, folder, "--model")
    if settings.detection_model is None:
        _check_new_names(settings, read)
        return _ready(read, _as_before(settings, read.file, as_before), folder, measured=as_before is None)
    if (task := read.file.task).kind != "segment":
        raise ModelError(f"{read.what}: for {task.title}, but beside --detection-model its masks are needed")
    boxes = {"model": settings.detection_model, "refine": False}
    read_boxes = _read(settings.model_copy(update=boxes), folder, "--detection-model")
    _check_new_names(settings, read, read_boxes)
    ready = partial(_ready, folder=folder, measured=as_before is None)
    model = ready(read, _as_before(settings, read.file, as_before))
    try:
        return PairedModel(ready(read_boxes, _as_before(settings, read_boxes.file, as_before)), model)
    except ModelError:
        model.close()
        raise


def _as_before(settings: DetectorSettings, file: ModelFile, runtime: str | None) -> DetectorSettings:
    """Return the settings with which a model runs as an earlier one did; see `load_all`."""
    if runtime is None:
        return settings
    if runtime == INT8 and not file.has_int8:
        runtime = "openvino"
    if runtime in OF_WEIGHTS and isinstance(file, ExportedModel):
        runtime = UNMEASURED[True]
    return settings.model_copy(update={"runtime": runtime})


class SuccessiveLoading:
    """Loads one model after another, each beside the one before; see `load_all`.

    With `--runtime auto` later models take the runtime of the first of their form, weights or exported, if they work
    under it; the first of the other form takes UNMEASURED. Measuring beside a model that runs gives wrong times, which
    would be kept for a week.
    """

    def __init__(self, settings: DetectorSettings, folder: Path) -> None:
        self._settings = settings
        self._folder = folder
        self._runtimes: dict[bool, str] = {}

    def load(self, file: Path) -> Model:
        """Load a model's file; raises ModelError."""
        settings = self._settings.model_copy(update={"model": str(file)})
        exported = is_exported(str(file))
        runtime = self._runtimes.get(exported)
        if self._runtimes and runtime is None and settings.runtime == "auto":
            runtime = UNMEASURED[exported]
        model = self._loaded(settings, runtime)
        if (found := _runtime_of(model)) is not None:
            self._runtimes.setdefault(exported, found)
        return model

    def _loaded(self, settings: DetectorSettings, runtime: str | None) -> Model:
        """Load under this runtime if the model works under it, else as asked for."""
        if runtime is not None and runtime != settings.runtime:
            try:
                return load_all(settings, self._folder, as_before=runtime)
            except ModelError as error:
                log.warning("not under %s, as the model before it: %s", runtime, error)
        return load_all(settings, self._folder)


def _runtime_of(model: Model) -> str | None:
    """Return what a model, or the one of `--model` in a pair, runs under."""
    of = model.masks if isinstance(model, PairedModel) else model
    return of.facts.runtime if isinstance(of, Pipeline) else None


def load(settings: DetectorSettings, folder: Path, refiner: Refiner | None = None) -> Pipeline:
    """Load the model and run it once, so that the first real frame does not wait. Takes seconds; call it off the loop.

    folder: where Ultralytics keeps its settings, so that they are nobody's but ours, and what is exported if the cache
    cannot be written. refiner: instead of that of the weights.

    Raises:
        ModelError: the file is no model, or of a task that finds no objects, or cannot run as asked for.
    """
    read = _read(settings, folder, "--model")
    _check_new_names(settings, read)
    return _ready(read, settings, folder, refiner)


@dataclass(frozen=True, slots=True)
class _Read:
    """A model's file and its detection criteria.

    names: of the classes, by label, as they are reported. what: how to call the file in messages.
    """

    file: ModelFile
    names: Mapping[int, str]
    criteria: Criteria
    what: str


def _read(settings: DetectorSettings, folder: Path, option: str) -> _Read:
    file = read_model(
        settings.model,
        folder,
        option,
        refine=settings.refine,
        nms=settings.nms,
        side=settings.image_size,
        download=settings.download,
    )
    what = f"{option} {settings.model}"
    agnostic = file.agnostic if settings.agnostic_nms is None else settings.agnostic_nms
    criteria = Criteria(agnostic=agnostic, class_confidence=settings.confidences)
    names = renamed(file.names, settings.new_names)
    try:
        return _Read(file, names, criteria.tuned(_tuning(settings), names), what)
    except TuningError as error:
        option = "--classes" if set(settings.classes) - set(names.values()) else "--class-confidence"
        raise ModelError(f"{option} with {what}: {error}") from error


def read_model(
    model: str,
    folder: Path,
    option: str,
    *,
    refine: bool = True,
    nms: bool | None = None,
    side: int | None = None,
    download: bool = False,
) -> ModelFile:
    """Read a model's file, weights or exported; see `load_weights` and `read_exported`. Nothing goes on the network.

    folder: where Ultralytics keeps its settings.

    Raises:
        ModelError: it cannot be used.
    """
    if is_exported(model):
        set_environment(folder, download=download)
        return read_exported(model, option, refine=refine, nms=nms, side=side)
    if missing := not_installed(WEIGHTS_NEED):
        raise ModelError(
            f"{option} {model}: {missing[0]} is not installed; see fleetsight's extra [detector], or export the model"
            " where it is: fleetsight model export"
        )
    keep_offline(folder, download=download)
    from services.detector.runtime.weights import load_weights  # noqa: PLC0415 - it is heavy

    return load_weights(model, option, refine=refine, nms=nms, download=download)


def _check_new_names(settings: DetectorSettings, *read: _Read) -> None:
    """Raise ModelError for new names of classes that no model has."""
    known = [name for each in read for name in each.file.names.values()]
    if unknown := settings.new_names.keys() - set(known):
        what = " and ".join(each.what for each in read)
        raise ModelError(
            f"--class-names with {what}: no class is called {min(unknown)[:80]!r}; known are {listed(known)}"
        )


def _max_batch(running: RunningModel, blank: NDArray[np.uint8], settings: DetectorSettings, *, measured: bool) -> int:
    """Return how many images a call is to compute; without measuring as many as may pay."""
    if not running.many:
        return 1
    return batch_size(running.engine, blank, settings.max_age_s) if measured else BATCH_ON_GPU


def _ready(
    read: _Read,
    settings: DetectorSettings,
    folder: Path,
    refiner: Refiner | None = None,
    *,
    measured: bool = True,
) -> Pipeline:
    """Return a model that is ready to use. measured: whether nothing else runs, so that times can be measured."""
    file = read.file
    longest = settings.image_size or file.longest
    if not LEAST_SIDE <= longest <= MOST_SIDE:
        raise ModelError(f"{read.what}: trained at {longest} pixels, not at {LEAST_SIDE} to {MOST_SIDE}: --image-size?")
    fixed = file.fixed if isinstance(file, ExportedModel) else None
    facts = Facts(
        printable(file.path.name), settings.runtime, read.names, file.task, longest, file.stride, file.head, fixed
    )
    cv2.setNumThreads(1)  # what it would share among threads is smaller than the sharing
    try:
        blank = facts.blank()
        running = _running(file, settings, longest, folder, blank, refine=refiner is None)
        return Pipeline(
            replace(facts, runtime=running.runtime),
            running.engine,
            read.criteria,
            blank=blank,
            reference=running.reference,
            refiner=refiner or running.refiner,
            max_batch=_max_batch(running, blank, settings, measured=measured),
            in_flight=3 if running.many else 2,
        )
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"{read.what}: not a model that can be used: {first_line(error)}") from error


def _running(
    file: ModelFile, settings: DetectorSettings, longest: int, folder: Path, blank: NDArray[np.uint8], *, refine: bool
) -> RunningModel:
    if isinstance(file, ExportedModel):
        return running_export(file, settings, longest, folder, blank)
    from services.detector.runtime.torch_loading import running_weights  # noqa: PLC0415 - it is heavy
    from services.detector.runtime.weights import Weights  # noqa: PLC0415 - as above

    if not isinstance(file, Weights):
        raise TypeError(type(file).__name__)
    return running_weights(file, settings, longest, folder, blank, refine=refine)


def tracking(settings: DetectorSettings, model: Model, is_shipped: Callable[[], bool] | None = None) -> Tracking | None:
    """Return the tracker of a model's objects; the model must have been loaded here.

    is_shipped: whether it is the shipped model now, unless the settings say it.
    """
    if settings.tracker == "off":
        return None
    if settings.tracker == "bytetrack":
        if missing := not_installed(WEIGHTS_NEED):
            raise ModelError(
                f"--tracker bytetrack: {missing[0]} is not installed; see fleetsight's extra [detector], or use botsort"
            )
        keep_torch_offline(download=settings.download)
    shipped = settings.is_shipped

    def neutral() -> float:
        confidence = model.tuning.confidence
        known = settings.track_score or (NEUTRAL if (is_shipped() if is_shipped else shipped) else None)
        return known or neutral_score(settings.confidence if confidence is None else confidence)

    return Tracking(partial(CameraTracker, settings.tracker, neutral))


def _tuning(settings: DetectorSettings) -> Tuning:
    return Tuning(
        confidence=settings.confidence,
        iou=settings.iou,
        max_detections=settings.max_detections,
        classes=settings.classes,
    )
