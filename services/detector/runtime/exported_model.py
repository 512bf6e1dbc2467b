"""Reads a model that Ultralytics exported, which runs without torch: an ONNX file, or a folder of OpenVINO's."""

import ast
import base64
import binascii
import hashlib
import logging
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from schemas.models import MAX_MODEL_BYTES
from services.detector.model import ModelError, first_line
from services.detector.runtime.model_file import (
    COLOURS,
    HEADS,
    ONNX_SUFFIX,
    Head,
    ModelFile,
    NamesError,
    TaskError,
    class_names,
    task_of,
)
from services.whole_file import is_everybodys

log = logging.getLogger(__name__)

Shape = tuple[int | None, ...]
"""Images, channels, height and width of an input; None where any number will do."""

METADATA_FILE: Final = "metadata.yaml"
"""Of a folder of OpenVINO's, beside the .xml and the .bin file."""

HEAD: Final = "fleetsight.head"
REFINER: Final = "fleetsight.refiner"
AGNOSTIC: Final = "fleetsight.agnostic"
SOURCE: Final = "fleetsight.source"
"""Entries of ours beside Ultralytics' own: the branch of the head, the refiner as an ONNX file in base64, whether the
model suppresses overlapping boxes of all classes by default, and the SHA-256 of the weights that the file was made
of."""

INT8: Final = "fleetsight.int8"
INT8_REFINER: Final = "fleetsight.int8_refiner"
"""The same networks in INT8, compressed by zlib and in base64, where the file has been made with them."""

MOST_STRIDE: Final = 256
"""Pixels; of Ultralytics' models the largest is 64."""

RT_DETR: Final = "RTDETRDecoder"
"""The head's name in Ultralytics' metadata."""

CURE: Final = "export it with `fleetsight model export` or `yolo export`"


@dataclass(frozen=True, slots=True)
class Int8Networks:
    """A model's networks in INT8, each as the content of an ONNX file. refiner: as of `ExportedModel`."""

    network: bytes
    refiner: bytes | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedModel(ModelFile):
    """An exported model.

    file: to be loaded, the ONNX or the .xml file. fixed: height and width of the only input that it takes, None where
    it takes any. many: whether it takes more than one image at once. refiner: of its masks as the content of an ONNX
    file, if it has one and it is wanted. int8: its INT8 networks, if it has them.
    """

    file: Path
    fixed: tuple[int, int] | None
    many: bool
    refiner: bytes | None
    int8: Int8Networks | None = None

    @property
    def has_int8(self) -> bool:
        """See `ModelFile.has_int8`."""
        return self.int8 is not None


class _ExportError(ValueError):
    """The file cannot be used; the message says why."""


def read_exported(
    model: str,
    option: str = "--model",
    *,
    refine: bool = True,
    nms: bool | None = None,
    side: int | None = None,
) -> ExportedModel:
    """Read what an exported model says about itself. Its network is not run.

    refine: with its refiner. nms: as requested, see `DetectorSettings.nms`. side: as requested, of the input in pixels.

    Raises:
        ModelError: it is none of Ultralytics' exports, of a task that finds no objects, or not as requested.
    """
    what = f"{option} {model}"
    try:
        path = Path(model)
        file = path if path.suffix.lower() == ONNX_SUFFIX else _xml_in(path)
        metadata, shape = _of_onnx(file) if file == path else _of_openvino(path, file)
        found = _described(path, file, metadata, shape, refine=refine)
    except (NamesError, TaskError, _ExportError) as error:
        raise ModelError(f"{what}: {error}") from error
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"{what}: not a model that can be used: {first_line(error)}") from error
    for each in {file, file.with_suffix(".bin")}:
        if each.exists() and is_everybodys(each):
            log.warning("%s: everybody on this machine could exchange the model: chmod o-w %s", what, each)
    if nms is not None and nms is not (found.head == "nms"):
        has = "needs NMS" if found.head == "nms" else "finds each object once"
        raise ModelError(f"{'--nms' if nms else '--no-nms'} with {what}: the head that it was exported with {has}")
    if side is not None and found.fixed is not None and side != found.longest:
        raise ModelError(f"--image-size {side} with {what}: it was exported for {found.longest} pixels alone")
    return found


def _xml_in(folder: Path) -> Path:
    files = sorted(folder.glob("*.xml"))
    if len(files) != 1:
        raise _ExportError(f"{len(files)} .xml files in the folder: a model has one")
    return files[0]


def _of_onnx(file: Path) -> tuple[Mapping[str, Any], Shape]:
    """Return an ONNX file's metadata, and the shape of its input."""
    try:
        import onnxruntime  # noqa: PLC0415 - it may not be there

        from services.detector.runtime.onnx_engine import alone  # noqa: PLC0415 - as above
    except ModuleNotFoundError as error:
        raise _ExportError("onnxruntime is not installed; see fleetsight's extra [detector-onnx]") from error
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.log_severity_level = 4
    content = file.read_bytes()  # of a path it takes texts alone
    session = onnxruntime.InferenceSession(content, alone(options), providers=["CPUExecutionProvider"])
    told = dict(session.get_modelmeta().custom_metadata_map)
    for name in told.keys() & {"names", "imgsz", "kpt_shape"}:
        try:
            told[name] = ast.literal_eval(told[name])
        except (ValueError, SyntaxError, MemoryError, RecursionError) as error:
            raise _ExportError(f"its {name} cannot be read: {CURE}") from error
    given, *others = session.get_inputs()
    if others:
        raise _ExportError(f"it has {1 + len(others)} inputs, not an image alone")
    return told, tuple(side if isinstance(side, int) else None for side in given.shape)


def _of_openvino(folder: Path, file: Path) -> tuple[Mapping[str, Any], Shape]:
    """Return the metadata beside an OpenVINO model, and the shape of its input."""
    try:
        from services.detector.runtime.openvino_engine import input_shape  # noqa: PLC0415 - it may not be there
    except ModuleNotFoundError as error:
        raise _ExportError("openvino is not installed; see fleetsight's extra [detector-onnx]") from error
    if not file.with_suffix(".bin").is_file():
        raise _ExportError(f"{file.with_suffix('.bin').name}, which has its weights, is missing beside {file.name}")
    metadata = folder / METADATA_FILE
    told = yaml.safe_load(metadata.read_text(encoding="utf-8")) if metadata.is_file() else {}
    if not isinstance(told, Mapping):
        raise _ExportError(f"its {METADATA_FILE} holds no entries: {CURE}")
    return told, input_shape(file)


def _described(path: Path, file: Path, told: Mapping[str, Any], shape: Shape, *, refine: bool) -> ExportedModel:
    if missing := [name for name in ("task", "names", "stride", "imgsz") if name not in told]:
        raise _ExportError(f"it does not say its {', '.join(missing)}: {CURE}")
    task = task_of(str(told["task"]), told.get("kpt_shape"))
    images, channels, height, width = shape
    if channels != COLOURS:
        raise _ExportError(f"it is for images of {channels} channels, and cameras have {COLOURS}: train it on RGB")
    if images not in (None, 1):
        raise _ExportError(f"it is for {images} images at once: export it with batch=1, or dynamic=True")
    if (height is None) != (width is None):
        raise _ExportError("one side of its input is fixed, the other is not: export it with or without dynamic=True")
    stride = int(float(told["stride"]))
    if not 1 <= stride <= MOST_STRIDE:
        raise _ExportError(f"its stride is {stride} pixels, not 1 to {MOST_STRIDE}: {CURE}")
    fixed = None if height is None or width is None else (height, width)
    sides = told["imgsz"] if isinstance(told["imgsz"], list | tuple) else [told["imgsz"]]
    return ExportedModel(
        path=path,
        digest=_digest(file),
        names=class_names(told["names"]),
        task=task,
        longest=max(fixed or map(int, sides)),
        stride=max(32, stride),
        head=_head(told),
        agnostic=told.get(AGNOSTIC) == str(True),
        file=file,
        fixed=fixed,
        many=images is None,
        refiner=_content(told, REFINER, "refiner") if refine else None,
        int8=_int8(told, refine=refine),
    )


def _head(told: Mapping[str, Any]) -> Head:
    kept: Head | None = next((each for each in HEADS if each == told.get(HEAD)), None)
    if kept is not None:
        return kept
    if told.get("head") == RT_DETR:
        return "rt-detr"
    return "nms-free" if str(told.get("end2end")) == str(True) else "nms"


def _int8(told: Mapping[str, Any], *, refine: bool) -> Int8Networks | None:
    network = _content(told, INT8, "INT8 network", compressed=True)
    if network is None:
        return None
    refiner = _content(told, INT8_REFINER, "INT8 refiner", compressed=True) if refine else None
    return Int8Networks(network, refiner)


def _content(told: Mapping[str, Any], entry: str, what: str, *, compressed: bool = False) -> bytes | None:
    content = told.get(entry)
    try:
        part = base64.b64decode(content, validate=True) if content else None
        return _decompressed(part) if part and compressed else part
    except (binascii.Error, ValueError, zlib.error) as error:
        raise _ExportError(f"its {what} is damaged: export it again") from error


def _decompressed(part: bytes) -> bytes:
    whole = zlib.decompressobj()
    content = whole.decompress(part, MAX_MODEL_BYTES)
    if not whole.eof:
        raise zlib.error("cut off, or too large")
    return content


def _digest(file: Path) -> str:
    """Return the SHA-256 of a model's file, and of the weights beside an .xml file."""
    digest = hashlib.sha256(file.read_bytes())
    if file.suffix == ".xml":
        digest.update(file.with_suffix(".bin").read_bytes())
    return digest.hexdigest()
