"""Loads a model that is ready to use, from settings."""

import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.printing import printable
from schemas.tuning import Tuning
from services.detector.model import Model, ModelError, TuningError, first_line
from services.detector.pairing import PairedModel
from services.detector.runtime.choosing import Runtime, RuntimeTarget, check_installed, choose
from services.detector.runtime.criteria import Criteria, listed, renamed
from services.detector.runtime.engine import BATCH_ON_GPU, Engine
from services.detector.runtime.exporting import discard, exported
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.offline import keep_offline
from services.detector.runtime.pipeline import Facts, Pipeline, prove
from services.detector.runtime.postprocess import OutputError
from services.detector.runtime.refinement.refiner import Refiner, blank_close_ups
from services.detector.settings import LEAST_SIDE, MOST_SIDE, DetectorSettings
from services.detector.tracking.confirmed_tracks import NEUTRAL, neutral_score
from services.detector.tracking.trackers import CameraTracker
from services.detector.tracking.tracks import Tracking

if TYPE_CHECKING:
    import torch

    from services.detector.runtime.refinement.network import RefinerNetwork
    from services.detector.runtime.weights import Weights

log = logging.getLogger(__name__)

ONNX: Final = ("onnx", "openvino")
"""Runtimes beside which masks are refined under ONNX Runtime: it takes less time than torch."""


def load_all(settings: DetectorSettings, folder: Path) -> Model:
    """Load the model, and the one for boxes if there is one; see `load`. Both are read before either is exported."""
    read = _read(settings, folder, "--model")
    if settings.detection_model is None:
        _check_new_names(settings, read)
        return _ready(read, settings, folder)
    if not read.weights.segments:
        raise ModelError(f"{read.what}: it has no masks, which --detection-model needs it for")
    boxes = {"model": settings.detection_model, "refine": False}
    read_boxes = _read(settings.model_copy(update=boxes), folder, "--detection-model")
    _check_new_names(settings, read, read_boxes)
    model = _ready(read, settings, folder)
    try:
        return PairedModel(_ready(read_boxes, settings, folder), model)
    except ModelError:
        model.close()
        raise


class SuccessiveLoading:
    """Loads one model after another, each beside the one before; see `load_all`.

    With `--runtime auto` later models take the runtime of the first, if they work under it: what is measured beside a
    model that runs is wrong, and would be kept for a week.
    """

    def __init__(self, settings: DetectorSettings, folder: Path) -> None:
        self._settings = settings
        self._folder = folder
        self._runtime: str | None = None

    def load(self, weights: Path) -> Model:
        """Load weights; raises ModelError."""
        settings = self._settings.model_copy(update={"model": str(weights)})
        if self._runtime is None:
            model = load_all(settings, self._folder)
            self._runtime = _runtime_of(model)
            return model
        try:
            return load_all(settings.model_copy(update={"runtime": self._runtime}), self._folder)
        except ModelError:
            if self._runtime == settings.runtime:
                raise
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
    """Loaded weights and their detection criteria.

    names: of the classes, by label, as they are reported. what: how to call the weights in messages.
    """

    weights: "Weights"
    names: Mapping[int, str]
    criteria: Criteria
    what: str


def _read(settings: DetectorSettings, folder: Path, option: str) -> _Read:
    keep_offline(folder, download=settings.download)
    from services.detector.runtime.weights import load_weights  # noqa: PLC0415 - it is heavy

    weights = load_weights(settings.model, option, refine=settings.refine, nms=settings.nms, download=settings.download)
    what = f"{option} {settings.model}"
    agnostic = weights.agnostic if settings.agnostic_nms is None else settings.agnostic_nms
    criteria = Criteria(agnostic=agnostic, class_confidence=settings.confidences)
    names = renamed(weights.names, settings.new_names)
    try:
        return _Read(weights, names, criteria.tuned(_tuning(settings), names), what)
    except TuningError as error:
        option = "--classes" if set(settings.classes) - set(names.values()) else "--class-confidence"
        raise ModelError(f"{option} with {what}: {error}") from error


def _check_new_names(settings: DetectorSettings, *read: _Read) -> None:
    """Raise ModelError for new names of classes that no model has."""
    known = [name for each in read for name in each.weights.names.values()]
    if unknown := settings.new_names.keys() - set(known):
        what = " and ".join(each.what for each in read)
        raise ModelError(
            f"--class-names with {what}: no class is called {min(unknown)[:80]!r}; known are {listed(known)}"
        )


def _ready(read: _Read, settings: DetectorSettings, folder: Path, refiner: Refiner | None = None) -> Pipeline:
    from services.detector.runtime.weights import device_of  # noqa: PLC0415 - it is heavy

    weights = read.weights
    device = device_of(settings.device)
    longest = settings.image_size or weights.longest
    if not LEAST_SIDE <= longest <= MOST_SIDE:
        raise ModelError(f"{read.what}: trained at {longest} pixels, not at {LEAST_SIDE} to {MOST_SIDE}: --image-size?")
    on_gpu = device.type == "cuda"
    try:
        runtime, engine, reference = _engines(settings, weights, device, longest, folder)
        if refiner is None and weights.refiner is not None:
            refiner = _refiner(weights.refiner, runtime, device, _threads(settings))
        name, segments = printable(weights.path.name), weights.segments
        return Pipeline(
            Facts(name, runtime, read.names, segments, longest, weights.stride, weights.head),
            engine,
            read.criteria,
            blank=_blank(weights, longest),
            reference=None if runtime == "torch" else reference,
            refiner=refiner,
            max_batch=BATCH_ON_GPU if on_gpu else 1,
            in_flight=3 if on_gpu else 2,
        )
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"{read.what}: not a model that can be used: {first_line(error)}") from error


def tracking(settings: DetectorSettings, model: Model, is_shipped: Callable[[], bool] | None = None) -> Tracking | None:
    """Return the tracker of a model's objects; the model must have been loaded here.

    is_shipped: whether it is the shipped model now, unless the settings say it.
    """
    if settings.tracker == "off":
        return None
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


def _engines(
    settings: DetectorSettings, weights: "Weights", device: "torch.device", longest: int, folder: Path
) -> tuple[Runtime, Engine, Engine]:
    """Return the runtime, the model under it, and the model under torch."""
    import torch  # noqa: PLC0415

    from services.detector.runtime.nms_branches import keep_branch  # noqa: PLC0415 - it is heavy
    from services.detector.runtime.torch_engine import TorchEngine  # noqa: PLC0415

    threads = _threads(settings)
    cv2.setNumThreads(1)  # what it would share among threads is smaller than the sharing
    keep_branch(weights.model, weights.head)
    reference = TorchEngine(weights.model, device)
    torch.set_num_threads(threads)  # Ultralytics leaves it at cores - 1
    gpu = "" if device.type != "cuda" else torch.cuda.get_device_name(device)
    place = RuntimeTarget(
        weights.digest, longest, device.type, threads, settings.cache, spare=folder / "exported", gpu=gpu
    )
    blank = _blank(weights, longest)

    def make(runtime: Runtime) -> Engine:
        made = _make(runtime, weights=weights, device=device, place=place, reference=reference)
        prove(made, blank, weights.names, weights.stride, weights.head)
        return made

    if settings.runtime == "auto":
        try:
            make("torch")  # what ails the weights is said at once, and of all runtimes
        except OutputError:
            raise
        except Exception as error:  # noqa: BLE001 - `choose` takes those that work
            log.debug("torch does not work here: %s", first_line(error))
        return *choose(make, place, blank), reference
    check_installed(settings.runtime)
    return settings.runtime, make(settings.runtime), reference


def _threads(settings: DetectorSettings) -> int:
    return settings.threads or len(os.sched_getaffinity(0))


def _refiner(network: "RefinerNetwork", runtime: Runtime, device: "torch.device", threads: int) -> Refiner:
    """Return the refiner under ONNX Runtime where that helps and works, else under torch. Run once: see `load`.

    Under OpenVINO it takes as long.
    """
    seen = blank_close_ups(1, network.prototypes)
    if device.type == "cpu" and runtime in ONNX and find_spec("onnxruntime") is not None:
        try:
            refiner = _onnx_refiner(network, threads)
            refiner.run(seen)
        except Exception as error:  # noqa: BLE001 - whatever ails one library, torch works
            log.warning("masks are refined under torch: onnx cannot: %s", first_line(error))
        else:
            log.info("masks are refined under onnx")
            return refiner
    from services.detector.runtime.refinement.torch_refiner import TorchRefiner  # noqa: PLC0415 - it is heavy

    slower = TorchRefiner(network, device)
    slower.run(seen)
    return slower


def _onnx_refiner(network: "RefinerNetwork", threads: int) -> Refiner:
    from services.detector.runtime.refinement import exporting  # noqa: PLC0415 - it is heavy
    from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner  # noqa: PLC0415 - it may not be there

    return OnnxRefiner(exporting.onnx_of(network), threads)


def _gpu(device: "torch.device") -> int | None:
    return device.index or 0 if device.type == "cuda" else None


def _make(
    runtime: Runtime, *, weights: "Weights", device: "torch.device", place: RuntimeTarget, reference: Engine
) -> Engine:
    export = partial(exported, weights, cache=place.cache, device=str(device), longest=place.longest)
    file = partial(export, gpu=place.gpu, spare=place.spare)
    match runtime:
        case "torch":
            return reference
        case "onnx":
            from services.detector.runtime.onnx_engine import OnnxEngine  # noqa: PLC0415

            return _loaded(partial(OnnxEngine, threads=place.threads, gpu=_gpu(device)), partial(file, "onnx"))
        case "openvino":
            from services.detector.runtime.openvino_engine import OpenVinoEngine  # noqa: PLC0415

            return _loaded(partial(OpenVinoEngine, threads=place.threads), partial(file, "onnx"))
        case "tensorrt":
            from services.detector.runtime.torch_engine import TorchEngine  # noqa: PLC0415

            return _loaded(partial(TorchEngine, device=device), partial(file, "engine"))


def _loaded(engine: Callable[[Path], Engine], file: Callable[..., Path]) -> Engine:
    """Return the exported model; one that cannot be loaded may be damaged, and is exported again."""
    path = file()
    try:
        return engine(path)
    except Exception as error:  # noqa: BLE001 - if the file is not to blame, it says so once more
        log.warning("%s cannot be loaded, and is exported again: %s", path, first_line(error))
        discard(path.parent)
        return engine(file(damaged=path))


def _blank(weights: "Weights", longest: int) -> NDArray[np.uint8]:
    height, width = Letterbox.fit(480, 640, longest, weights.stride, stretched=weights.head == "rt-detr").shape
    return np.zeros((1, height, width, 3), np.uint8)
