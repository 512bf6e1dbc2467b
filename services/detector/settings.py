"""Settings of a detector worker."""

import os
from collections import Counter
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, field_validator, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import SharingSettings
from schemas.header import MAX_LABEL
from schemas.printing import printable
from services.detector.regions import parse_region
from services.detector.worker_role import OPINION

LEAST_SIDE: Final = 32
MOST_SIDE: Final = 4096
"""Limits of a model's input side, in pixels."""

MOST_THREADS: Final = 1024

FLEET: Final = "fleet"
"""Stands for the model that the monitor's registry has in force."""

WEIGHTS_FOLDER = Path(__file__).parent / "weights"
SHIPPED: Final = "warehouse-n-seg"
"""Stands for the shipped model in the form that fits the machine: see `shipped_file`."""

SHIPPED_MODEL = WEIGHTS_FOLDER / f"{SHIPPED}.pt"
SHIPPED_EXPORT = WEIGHTS_FOLDER / f"{SHIPPED}.onnx"
"""The same model, exported: a worker with it starts in seconds and takes a quarter of the memory."""

GPU: Final = Path("/dev/nvidiactl")
"""Is there where NVIDIA's driver is."""

WEIGHTS_SUFFIX: Final = ".pt"
WEIGHTS_NEED: Final = ("torch", "ultralytics")
"""Packages without which weights are of no use."""


DEADLINE_SLACK_S: Final = 0.03
"""Seconds beyond one call that a frame may wait for its turn, without `--max-age-s`."""

LEAST_AGE_S: Final = 0.08
"""Lower bound of that maximum age, however fast the model is: link delays vary."""


def not_installed(packages: Iterable[str]) -> list[str]:
    """Return those of some packages that are missing here. Imports none of them."""
    return [each for each in packages if find_spec(each) is None]


def is_weights(model: str) -> bool:
    """Whether a name is that of Ultralytics weights, here or to be downloaded."""
    return Path(model).suffix.lower() == WEIGHTS_SUFFIX


def is_openvino_folder(path: Path) -> bool:
    """Whether a path is a folder with a model that was exported for OpenVINO."""
    return path.is_dir() and any(path.glob("*.xml"))


ON_PROCESSORS: Final = ("openvino", "openvino-int8")
"""Runtimes that use no GPU."""


def shipped_file(device: str | None, runtime: str | None) -> Path:
    """Return the file of the shipped model: the exported one on a processor, where ONNX Runtime can read it.

    runtime: as requested; OpenVINO computes on the processor, whatever device there is.
    """
    on = (device or ("cuda" if GPU.exists() else "cpu")).strip().lower()
    wants_torch = runtime in ("torch", "tensorrt") or (on != "cpu" and runtime not in ON_PROCESSORS)
    can_read, can_run_weights = not not_installed(["onnxruntime"]), not not_installed(WEIGHTS_NEED)
    return SHIPPED_MODEL if can_run_weights and (wants_torch or not can_read) else SHIPPED_EXPORT


def shipped_path(model: str) -> str:
    """Return the path of shipped weights that are given by their name alone; anything else as it is."""
    shipped = WEIGHTS_FOLDER / model
    return str(shipped) if model == shipped.name and not Path(model).exists() and shipped.is_file() else model


def check_is_file(option: str, weights: str) -> None:
    """Raise ValueError for weights that are not here, and are not to be downloaded. option: that names them."""
    if is_openvino_folder(Path(weights)):
        return
    if Path(weights).is_dir():
        raise ValueError(f"{option} {printable(weights)}: a folder")
    if weights == FLEET and not Path(weights).is_file():
        raise ValueError(f"{option} {FLEET}: only --model of `fleetsight detector` follows the fleet's; name a file")
    if not Path(weights).is_file():
        raise ValueError(f"{option} {printable(weights)}: no such file (--download lets Ultralytics download it)")


def default_cache() -> Path:
    """Return the user's cache folder; without a home directory, one that keeps nothing."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fleetsight"
    except RuntimeError:  # no folder that others can write to: cached models are executed
        return Path(os.devnull) / "fleetsight"


def _new_name(text: str) -> str:
    old, _, new = text.rpartition("=")
    if not old.strip() or not new.strip():
        raise ValueError(f"{printable(text)}: write a class's name and its new name, such as parcel=box")
    if len(new.strip()) > MAX_LABEL:
        raise ValueError(f"{printable(new)[:80]}: a name may have {MAX_LABEL} characters")
    return text


def _name_confidence(text: str) -> str:
    name, _, score = text.rpartition("=")
    try:
        known = bool(name.strip()) and 0 <= float(score) <= 1
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"{printable(text)}: write a class's name and a score from 0 to 1, such as forklift=0.5")
    return text


def _region(text: str) -> str:
    parse_region(text)
    return text


Region = Annotated[str, AfterValidator(_region)]
NewName = Annotated[str, AfterValidator(_new_name)]
NameConfidence = Annotated[str, AfterValidator(_name_confidence)]

Runtime = Literal["auto", "torch", "onnx", "openvino", "openvino-int8", "tensorrt"]


class InferenceSettings(BaseModel):
    """Settings of every process that runs a model on images: detection criteria and runtime."""

    heading: ClassVar = "the model"

    confidence: Annotated[float, Field(ge=0, le=1, description="a detection needs a higher score than this")] = 0.25
    iou: Annotated[float, Field(ge=0, le=1, description="IoU above which two boxes are one object")] = 0.7
    agnostic_nms: Annotated[
        bool | None,
        Field(
            description="report only the best of overlapping boxes, whatever their classes; by default only for YOLOE"
            " models, as in Ultralytics"
        ),
    ] = None
    nms: Annotated[
        bool | None,
        Field(
            description="suppress overlapping boxes; --no-nms uses the NMS-free head that YOLO26 and YOLOv10 models"
            " have. By default, boxes are suppressed wherever the model allows it"
        ),
    ] = None
    max_detections: Annotated[int, Field(ge=1, le=1000, description="maximum number of objects per image")] = 300
    classes: Annotated[
        list[str], Field(description="names of the classes to report; by default all classes of the model")
    ] = []
    class_names: Annotated[
        list[NewName],
        Field(
            description="other names for classes of the model, such as 'cardboard box=box,parcel=box'; classes that get"
            " one name become one"
        ),
    ] = []
    class_confidence: Annotated[
        list[NameConfidence],
        Field(
            description="scores that single classes need instead of --confidence, such as 'forklift=0.5,box=0.3', by"
            " their names after --class-names"
        ),
    ] = []
    refine: Annotated[
        bool,
        Field(
            description="refine masks with the refiner network, where the weights contain one; --no-refine is faster"
        ),
    ] = True
    image_size: Annotated[
        int | None,
        Field(ge=LEAST_SIDE, le=MOST_SIDE, description="longer side that images are scaled to; by default as trained"),
    ] = None
    int8: Annotated[
        bool,
        Field(
            description="let --runtime auto choose the INT8 networks of an exported model that has them, as the shipped"
            " one has; --no-int8 leaves them out"
        ),
    ] = True
    cache: Path = Field(
        default_factory=default_cache,
        description="folder for exported models, the choice of runtime and the models of --model fleet",
    )
    device: Annotated[str | None, Field(description="cpu, cuda:0, ...; by default the best available")] = None
    threads: Annotated[
        int, Field(ge=0, le=MOST_THREADS, description="CPU threads for inference; 0 uses every core")
    ] = 0

    @field_validator("class_names", "class_confidence")
    @classmethod
    def _each_class_once(cls, given: list[str]) -> list[str]:
        classes = Counter(text.rpartition("=")[0].strip() for text in given)
        for name, times in classes.items():
            if times > 1:
                raise ValueError(f"{printable(name)} is given {times} times; give each class once")
        return given

    @property
    def inference_threads(self) -> int:
        """CPU threads for inference."""
        return self.threads or len(os.sched_getaffinity(0))

    @property
    def new_names(self) -> dict[str, str]:
        """The new names of the model's classes, by the old ones."""
        return {old.strip(): new.strip() for old, _, new in (text.rpartition("=") for text in self.class_names)}

    @property
    def confidences(self) -> dict[str, float]:
        """The scores that single classes need, by name."""
        split = (text.rpartition("=") for text in self.class_confidence)
        return {name.strip(): float(score) for name, _, score in split}


class DetectorSettings(InferenceSettings, SharingSettings, BusSettings):
    """Run a YOLO model on the cameras whose results are subscribed to, one call per image."""

    model: Annotated[
        str,
        AfterValidator(shipped_path),
        Field(
            description="Ultralytics weights, or an exported model (an ONNX file or a folder of OpenVINO's), which"
            " needs no torch: a path; warehouse-n-seg, the shipped one, of which .pt or .onnx may be asked for;"
            " with --download a published model's name; or fleet, for what `fleetsight model use` puts in force"
        ),
    ] = SHIPPED
    opinion: Annotated[
        bool,
        Field(
            description="run this model for comparison beside the fleet's detector: it publishes only class lists, on"
            " a key of their own, for the monitor's rule disagree"
        ),
    ] = False
    detection_model: Annotated[
        str | None, Field(description="second model, for boxes; its objects get the masks of --model")
    ] = None
    regions: Annotated[
        list[Region],
        Field(
            description="regions of images that objects are looked for in, as ROBOT/CAMERA=CORNERS, like"
            " 'r1/front=0:0.3 1:0.3 1:1 0:1' (* stands for anything): each corner is ACROSS:DOWN, shares of width and"
            " height from the left and top. Several for one camera add up"
        ),
    ] = []
    accept_settings: Annotated[
        bool,
        Field(
            description="let requests change --confidence, --iou, --max-detections and --classes while the worker runs"
        ),
    ] = False
    download: Annotated[bool, Field(description="let Ultralytics download missing weights")] = False
    runtime: Annotated[
        Runtime,
        Field(description="inference runtime; auto measures those installed once a week and takes the fastest"),
    ] = "auto"
    tracker: Annotated[
        Literal["off", "bytetrack", "botsort"], Field(description="tracker that follows objects from frame to frame")
    ] = "botsort"
    track_score: Annotated[
        float | None,
        Field(
            gt=0,
            lt=1,
            description="score from which a detection is evidence for a track, which gets its number once there is"
            " enough; by default 0.33 for the shipped model, and a little below --confidence for others",
        ),
    ] = None
    max_age_s: Annotated[
        float | None,
        Field(
            gt=0,
            le=60,
            description="maximum age of a frame when its turn comes; older ones are dropped. By default the duration of"
            " one model call plus 30 ms, at least 80 ms; up to 2 s of delay on the link do not count while the model"
            " keeps up",
        ),
    ] = None

    @property
    def follows_fleet(self) -> bool:
        """Whether the model is the one that the monitor's registry has in force."""
        return self.model == FLEET

    @property
    def is_shipped(self) -> bool:
        """Whether the objects are found by the shipped model."""
        file = Path(self.detection_model or self.model)
        return file.is_file() and any(file.samefile(each) for each in (SHIPPED_MODEL, SHIPPED_EXPORT))

    @model_validator(mode="after")
    def _shipped_in_one_form(self) -> Self:
        given = "model" in self.model_fields_set
        if self.model == SHIPPED and not (given and Path(SHIPPED).exists()):
            self.model = str(shipped_file(self.device, self.runtime))
        return self

    @model_validator(mode="after")
    def _model_is_here(self) -> Self:
        for option, weights in (("--model", self.model), ("--detection-model", self.detection_model)):
            if weights is not None and not self.download and (option, weights) != ("--model", FLEET):
                check_is_file(option, weights)
        return self

    @model_validator(mode="after")
    def _opinion_is_of_one_model(self) -> Self:
        if self.opinion and self.follows_fleet:
            raise ValueError("--opinion tries one model beside the fleet's: name its file with --model, not fleet")
        return self

    @model_validator(mode="after")
    def _is_no_opinions_namesake(self) -> Self:
        if not self.opinion and self.worker.startswith(OPINION.prefix):
            raise ValueError(
                f"--worker {self.worker}: the prefix {OPINION.prefix!r} is reserved for --opinion workers; use another"
            )
        return self
