"""Makes INT8 networks with ONNX Runtime's quantizer, and compares what they find with single precision.

Weights are rounded to 8 bits per channel, inputs of convolutions to 8 bits over the mean of the extremes that pictures
have there. Between convolutions numbers stay as they are: activations rounded before SiLU lose the small ones, and a
fifth of the pictures got other classes. Convolutions that gain little and lose much stay in single precision: the first
ones, grouped ones, and the branch of the head that tells classes.
"""

import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.tuning import Tuning
from services.detector.model import Failed, ModelError, Request, first_line
from services.detector.pixels import ImageDecodeError, to_bgr
from services.detector.runtime.candidates import Candidates
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.engine import Engine
from services.detector.runtime.exported_model import Int8Networks
from services.detector.runtime.model_file import ModelFile
from services.detector.runtime.onnx_engine import OnnxEngine
from services.detector.runtime.overlap import Comparison
from services.detector.runtime.pipeline import Facts, Pipeline
from services.detector.runtime.postprocess import objects
from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner
from services.detector.runtime.refinement.refiner import AT_ONCE, CloseUps, Refiner, close_ups
from services.detector.stills import ROBOT, StillError, frame_of

CALIBRATING: Final = 64
"""Pictures whose activations are looked at."""
COMPARING: Final = 300
"""Further pictures, at most, on which the networks are compared."""
LEAST_COMPARING: Final = 100

FIRST: Final = 8
FIRST_OF_REFINER: Final = 1
"""First convolutions of a network that stay in single precision."""

CLASSES: Final = re.compile(r"/(one2one_)?cv3\.\d")
"""In names of the convolutions that tell classes, as Ultralytics' heads have them."""

THREADS: Final = 0
"""As many as there are cores."""

CURE: Final = "give more pictures like those of the cameras, with objects in them"
CAMERA: Final = CameraKey(ROBOT, ROBOT)

Feed = Sequence[NDArray[Any]]
"""The inputs of a network, in their order."""
Progress = Callable[[str, int, int], None]
"""Told a step's name, how many pictures are done, and how many there are."""


class Quantizer:
    """Makes INT8 networks of a model's networks in single precision.

    pictures: some calibrate, and on others both are compared. equal, compared: of how many of these both found the same
    classes.
    """

    def __init__(self, model: ModelFile, longest: int, pictures: Sequence[Path], progress: Progress) -> None:
        self._facts = Facts(model.path.name, "onnx", model.names, model.task, longest, model.stride, model.head)
        self._criteria = Criteria(agnostic=model.agnostic).tuned(Tuning(), model.names)
        self._calibrating, self._comparing = _shared_out(pictures)
        self._progress = progress
        self.compared = len(self._comparing)
        self.equal = 0

    def __call__(self, network: bytes, refiner: bytes | None) -> Int8Networks:
        """Return INT8 networks; both are given as the content of ONNX files.

        Raises:
            ModelError: a picture cannot be read, a library does not work, or INT8 finds too much else.
        """
        try:
            return self._made(network, refiner)
        except ModelError:
            raise
        except Exception as error:
            raise ModelError(f"--int8: the networks cannot be made or compared: {first_line(error)}") from error

    def _made(self, network: bytes, refiner: bytes | None) -> Int8Networks:
        facts, progress = self._facts, self._progress
        single, refines = OnnxEngine(network, THREADS, gpu=None), None
        in_int8 = _runtime()
        made = _int8(network, _images(self._calibrating, facts, progress), FIRST)
        if refiner is not None:
            seen = [each for file in self._calibrating if (each := self._seen(single, file)) is not None]
            if not seen:
                raise ModelError("--int8: the model finds no objects in the pictures; give pictures that show objects")
            feeds = ((each.pixels, each.features, each.labels, each.scores) for each in seen)
            refines = _int8(refiner, feeds, FIRST_OF_REFINER)
        ours = self._model(single, None if refiner is None else OnnxRefiner(refiner, THREADS))
        theirs = self._model(in_int8.engine(made), None if refines is None else in_int8.refiner(refines))
        self._compare(ours, theirs)
        return Int8Networks(made, refines)

    def _model(self, engine: Engine, refiner: Refiner | None) -> Pipeline:
        return Pipeline(self._facts, engine, self._criteria, blank=self._facts.blank(), refiner=refiner)

    def _compare(self, single: Pipeline, int8: Pipeline) -> None:
        """Raise ModelError if INT8 finds too much else in the pictures that did not calibrate it."""
        compared, before = Comparison(), int8.remarks
        try:
            for done, file in enumerate(self._comparing, 1):
                frame = _frame(file)
                compared.add(_found(single, frame), _found(int8, frame))
                self._progress("compare", done, self.compared)
        finally:
            single.close()
            int8.close()
        self.equal = compared.equal
        if failed := [each for each in int8.remarks if each not in before]:
            raise ModelError(f"--int8: {failed[0]}; export without --int8")
        if (reason := compared.too_different()) is not None:
            raise ModelError(f"--int8: {reason}; {CURE}, or export without --int8")

    def _seen(self, engine: Engine, file: Path) -> CloseUps | None:
        """Return close-ups of the objects in a picture; None without objects."""
        facts, pixels = self._facts, _pixels(file, self._facts)
        seen: list[CloseUps] = []

        def note(found: Candidates, prototypes: NDArray[np.float32]) -> None:
            seen.append(close_ups(pixels, found[:AT_ONCE], prototypes))

        (output,) = engine.run(pixels[None])
        about = (facts.letterbox(*pixels.shape[:2]), self._criteria, facts.names)
        objects(output, *about, masks=True, refine=note, head=facts.head, task=facts.task)
        return seen[0] if seen else None


def _found(model: Pipeline, frame: ImageFrame) -> Sequence[Detection]:
    (outcome,) = model.run([Request(CAMERA, frame, masks=True)])
    if isinstance(outcome, Failed):
        raise outcome.error
    return outcome.objects


@dataclass(frozen=True, slots=True)
class _Int8Runtime:
    """Makes INT8 networks ready to run."""

    engine: Callable[[bytes], Engine]
    refiner: Callable[[bytes], Refiner]


def _runtime() -> _Int8Runtime:
    """Return OpenVINO, under which detectors run INT8 networks, or ONNX Runtime where that is not installed."""
    if find_spec("openvino") is None:
        return _Int8Runtime(partial(OnnxEngine, threads=THREADS, gpu=None), partial(OnnxRefiner, threads=THREADS))
    from services.detector.runtime import openvino_engine  # noqa: PLC0415 - it may not be there

    return _Int8Runtime(
        partial(openvino_engine.OpenVinoEngine, threads=THREADS),
        partial(openvino_engine.OpenVinoRefiner, threads=THREADS),
    )


def _shared_out(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return pictures to calibrate with and others to compare on, both from all over the list."""
    least = CALIBRATING + LEAST_COMPARING
    if len(files) < least:
        raise ModelError(
            f"--int8: {len(files)} pictures in the folder; {least} are needed at least, {CALIBRATING} to calibrate and"
            f" {LEAST_COMPARING} to compare"
        )
    chosen = _evenly(files, CALIBRATING + COMPARING)
    calibrating = _evenly(chosen, CALIBRATING)
    used = set(calibrating)
    return calibrating, [each for each in chosen if each not in used]


def _evenly(files: Sequence[Path], most: int) -> list[Path]:
    count = min(most, len(files))
    return [files[index * len(files) // count] for index in range(count)]


def _int8(network: bytes, feeds: Iterable[Feed], first: int) -> bytes:
    """Return an ONNX file's content with its convolutions in INT8, but for sensitive ones and so many first ones."""
    import onnx  # noqa: PLC0415 - it may not be there
    from onnxruntime import quantization  # noqa: PLC0415 - it needs onnx

    model = onnx.load_from_string(network)
    convolutions = [each for each in model.graph.node if each.op_type == "Conv"]
    kept = [each.name for n, each in enumerate(convolutions) if n < first or _is_sensitive(each)]
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "int8.onnx"
        try:
            quantization.quantize_static(
                model,
                file,
                _reader([each.name for each in model.graph.input], iter(feeds)),
                quant_format=quantization.QuantFormat.QDQ,
                op_types_to_quantize=["Conv"],
                nodes_to_exclude=kept,
                per_channel=True,
                activation_type=quantization.QuantType.QUInt8,
                weight_type=quantization.QuantType.QInt8,
                calibrate_method=quantization.CalibrationMethod.MinMax,
                extra_options={"CalibMovingAverage": True, "OpTypesToExcludeOutputQuantization": ["Conv"]},
            )
        except ModelError:
            raise
        except Exception as error:
            raise ModelError(f"--int8: the quantizer cannot do this: {first_line(error)}") from error
        made = onnx.load(file)
    del made.graph.value_info[:]
    del made.metadata_props[:]
    content: bytes = made.SerializeToString(deterministic=True)
    return content


def _is_sensitive(convolution: Any) -> bool:
    groups = next((each.i for each in convolution.attribute if each.name == "group"), 1)
    return groups > 1 or CLASSES.search(convolution.name) is not None


def _reader(names: Sequence[str], feeds: Iterator[Feed]) -> Any:
    from onnxruntime.quantization import CalibrationDataReader  # noqa: PLC0415 - as above

    class Reader(CalibrationDataReader):  # type: ignore[misc]  # it is untyped
        def get_next(self) -> Mapping[str, NDArray[Any]] | None:
            given = next(feeds, None)
            return None if given is None else dict(zip(names, given, strict=True))

    return Reader()


def _images(files: Sequence[Path], facts: Facts, progress: Progress) -> Iterator[Feed]:
    for done, file in enumerate(files, 1):
        progress("calibrate", done, len(files))
        pixels = _pixels(file, facts)
        yield (np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], np.float32) / np.float32(255),)


def _pixels(file: Path, facts: Facts) -> NDArray[np.uint8]:
    """Return a picture in the model's input, height x width x RGB."""
    frame = _frame(file)
    letterbox = facts.letterbox(frame.height, frame.width)
    pixels = np.empty((*letterbox.shape, 3), np.uint8)
    try:
        letterbox.apply(to_bgr(frame), pixels)
    except ImageDecodeError as error:
        raise ModelError(f"--int8: {file}: {error}") from error
    return pixels


def _frame(file: Path) -> ImageFrame:
    try:
        return frame_of(file.read_bytes())
    except OSError as error:
        raise ModelError(f"--int8: {file}: {error.strerror}") from error
    except StillError as error:
        raise ModelError(f"--int8: {file}: {error}") from error
