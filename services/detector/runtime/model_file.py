"""A model as its file tells it, whichever kind of file that is: a checkpoint of weights, or an exported model."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

from schemas.detections import MAX_KEYPOINTS
from services.detector.settings import is_openvino_folder

Head = Literal["nms", "nms-free", "rt-detr"]
"""How objects are read off an output. nms: overlapping boxes are taken for one object. nms-free: each box is one, and
has every class that is sure enough. rt-detr: boxes are shares of a stretched image, and each is one object."""

HEADS: Final[tuple[Head, ...]] = get_args(Head)

Kind = Literal["segment", "detect", "pose", "obb", "classify"]
"""Ultralytics' name of a model's task."""

KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
COLOURS: Final = 3
"""Channels of a camera's image."""

ONNX_SUFFIX: Final = ".onnx"
EXPORTS: Final = "an ONNX file or a folder of OpenVINO's"


@dataclass(frozen=True, slots=True)
class Task:
    """A model's task. keypoints: of each object, of a model for poses; has_scores: each has a score of its own."""

    kind: Kind = "detect"
    keypoints: int = 0
    has_scores: bool = True

    @property
    def title(self) -> str:
        """The task in words, for people."""
        return _TITLES[self.kind]

    @property
    def has_masks(self) -> bool:
        """Whether objects get masks: a model's own, or rotated boxes as such."""
        return self.kind in {"segment", "obb"}

    @property
    def extras(self) -> int:
        """Numbers of each object beside its box and its classes, mask coefficients apart."""
        return 1 if self.kind == "obb" else self.keypoints * (3 if self.has_scores else 2)


DETECTION: Final = Task()

_TITLES: Final[Mapping[Kind, str]] = {
    "segment": "segmentation",
    "detect": "detection",
    "pose": "poses",
    "obb": "rotated boxes",
    "classify": "classification",
}


class TaskError(ValueError):
    """The task is none that finds anything in an image; the message says why."""


def task_of(kind: Any, keypoints: Any = None) -> Task:
    """Return the task as a model's file has it. keypoints: their number, and how many numbers each has.

    Raises:
        TaskError: it is unknown here.
    """
    known = next((each for each in KINDS if each == kind), None)
    if known is None:
        raise TaskError(f"a model for {kind!r}, not for one of {', '.join(KINDS)}")
    if known != "pose":
        return Task(known)
    try:
        count, numbers = map(int, keypoints)
    except (TypeError, ValueError):
        count, numbers = 0, 0
    if not 1 <= count <= MAX_KEYPOINTS or numbers not in (2, 3):
        raise TaskError(f"its keypoints are {keypoints}, not 1 to {MAX_KEYPOINTS} of 2 or 3 numbers each")
    return Task(known, count, has_scores=numbers == 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFile:
    """Facts that hold under every runtime.

    digest: of the file's content. longest: the longer side of the input in training, in pixels. head: how objects are
    read off the output. agnostic: whether the model's own default is to suppress overlapping boxes whatever their
    classes, as of YOLOE.
    """

    path: Path
    digest: str
    names: Mapping[int, str]
    task: Task
    longest: int
    stride: int
    head: Head = "nms"
    agnostic: bool = False

    @property
    def has_int8(self) -> bool:
        """Whether it contains its networks in INT8, too; weights never do."""
        return False


class NamesError(ValueError):
    """The names of a model's classes are unusable; the message says why."""


def is_exported(model: str) -> bool:
    """Whether a path names an exported model: an ONNX file, or a folder as OpenVINO has it."""
    path = Path(model)
    return path.suffix.lower() == ONNX_SUFFIX or is_openvino_folder(path)


def class_names(given: Any, classes: int | None = None) -> dict[int, str]:
    """Return the names of a model's classes, by label; renamed classes are often a list.

    given: names by label, or a list of them. classes: how many the model has, where that is known.

    Raises:
        NamesError: they are not one for each class.
    """
    if not isinstance(given, Mapping | list | tuple):
        raise NamesError(f"its names are a {type(given).__name__}, neither a list nor a dictionary")
    named = given if isinstance(given, Mapping) else dict(enumerate(given))
    names = {_label(key): _sendable(str(name)) for key, name in named.items()}
    if classes is not None and len(named) != classes:
        raise NamesError(f"{len(named)} names for {classes} classes")
    if not names or names.keys() != set(range(len(named))):
        raise NamesError("names of other classes")
    if unnamed := [label for label, name in names.items() if not name.strip()]:
        raise NamesError(f"class {unnamed[0]} has an empty name")
    return {int(label): name for label, name in names.items()}


def _label(key: Any) -> Any:
    """Return the whole number that a key stands for, such as 0.0 or "0"; another key as it is."""
    with suppress(ValueError):
        return int(float(key)) if isinstance(key, str | int | float) and float(key).is_integer() else key
    return key


def _sendable(name: str) -> str:
    """Return a name with lone surrogates escaped, which messages cannot carry."""
    return name.encode("utf-8", "backslashreplace").decode()
