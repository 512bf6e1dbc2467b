"""The model card that is written beside the weights."""

import platform
import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Final

from services.simulator.world import CLASSES
from services.training.checkpoints import ARCHITECTURE
from services.training.dataset import numbers_of
from services.training.evaluation.class_lists import REQUIRED_AREA, VISIBLE_AREA, ListFigures
from services.training.evaluation.near_objects import MATCHING_IOU, NEAR_AREA, NEAR_METRES, NearFigures
from services.training.evaluation.photographs import PhotographScore
from services.training.evaluation.precision import MIN_AREA, MaskFigures, Precision
from services.training.evaluation.predictor import CONFIDENCE
from services.training.evaluation.scenes import held_out_seeds
from services.training.evaluation.truths import MIN_VISIBILITY
from services.training.files import Effort
from services.training.fitting import device_name
from services.training.mixing import EMPTY_REPEATS, NONE_MADE, MadePictures
from services.training.settings import DECISIVE, TrainingSettings

PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "numpy", "opencv-python-headless")

_CARD: Final = """\
# {name}: {names}

{kind} (`{architecture}`, {count} classes, input {imgsz} pixels on the longer side, half
precision), {origin}.
Made, and this page written, by one command:

    {command}

- Seed {seed}{rendered}{scratch}.
{mixed}{averaged}{refiner}- The run took {wall_min:.0f} minutes by the clock and {cpu_min:.0f} minutes of processor
  time, rendering included, with {workers} workers on device {device}.
- Python {python}, {versions}.
{simulated}{photographs}
## What it is not

{limits}

Licence: AGPL-3.0-or-later, as the project and the architecture's definition in Ultralytics are.
"""

_SIMULATED: Final = """
## On scenes that it was not trained on

One picture of each of {holdout} scenes (seeds {first} to {last}), seen as a detector sees a camera's: COCO's average
precision of masks, over the objects of which at least {visibility:.0%} is visible, on at least {area:.1%} of the
picture. All other objects are ignore regions.

| class | objects | mask mAP50 | mask mAP50-95 |
|---|---|---|---|
{mask_rows}

By visible size, in pixels, over all classes:

| size | objects | mask mAP50 | mask mAP50-95 |
|---|---|---|---|
{size_rows}
{unrefined}
At a confidence of {confidence:.2f}, the detector's default, the list of classes was right in {exact:.1%} of these
pictures: it had every class with an object of which at least {visibility:.0%} is visible, on at least {required:.1%}
of the picture, and none without an object that is visible on more than {visible:.2%} of it. That default was chosen
with a look at pictures like these.

| class | pictures where it was missed | pictures where it was invented |
|---|---|---|
{list_rows}

On drives through held-out scenes, of the objects whose visible part covers at least {near_area:.0%} of the picture
within {near_metres:.0f} m, {near_share:.1%} were named right: a box of the right class with an IoU of at least
{iou:.1f}, at a confidence of at least {confidence:.2f}.

| class | near objects | named right | only named wrong | invented |
|---|---|---|---|---|
{near_rows}

"Invented" are predictions of at least the same size in these {pictures} pictures where nothing of that class was.
"""

_FROM_SCRATCH: Final = """: {coarse_epochs} epochs at half
  the size, {epochs} at the whole and {polish_epochs} more with the learning rate raised once again"""

_MIXED: Final = """\
- {data_epochs} epochs of {together}, varied in colour, size and place;
  classes that a source does not label count neither for nor against a prediction, and where boxes alone are known
  masks do not count. The learning rate began at {data_rate:g}; photographs without any of the classes were shown
  {empty_repeats} times as often as others.{made}
"""

_MADE: Final = """
  Among them are {collages} pictures made of the photographs: their objects (cut out by GrabCut where boxes alone are
  known) on photographs without any, and {plain} plain, empty ones."""

_AVERAGED: Final = """\
- The weights are the average of those trained so and, with a share of {keep:.2f}, of those that the run began with.
"""

_UNSEEN: Final = """\
It has seen no photograph: every picture it knows was rendered from cuboids. How it does on a real camera is not
measured; train on pictures of your own site before you rely on it."""

_SEEN: Final = """\
It has seen a few hundred photographs of a few places. On a real camera of another place it does as well as the table
of photographs says, at best; train on pictures of your own site before you rely on it."""

_AS_BEFORE: Final = """\
How many photographs its model was trained on is on the card of {start}. Train on pictures of your own site before you
rely on it on a real camera."""

_WORLDS_LIMITS: Final = """
Objects that are far, small or mostly hidden are often missed, and trolleys, posts or bare walls are sometimes taken for
forklifts. Things that it was never shown (people, cars, hand pallet trucks) may be taken for one of its classes."""

_OTHER_LIMITS: Final = """\
It has seen the photographs that it was trained on. On a camera of another place it does as well as the table of
photographs says, at best. Things that it was never shown may be taken for one of its classes."""

_PHOTOGRAPHS: Final = """
## On photographs that it was not trained on

{summary}

At the same confidence, boxes with an IoU of at least {iou:.1f}; of each source only the classes that it labels.
False alarms are predictions per picture where none of the classes is.

| source | pictures | class | labelled | recall | precision | false alarms |
|---|---|---|---|---|---|---|
{rows}
{licences}"""

_REFINER: Final = """\
- Masks are made finer, and judged, by a small network in the same file, trained for {refiner_epochs} epochs on
  {objects} things that the model found in {refiner_images} images of further scenes.
"""

_UNREFINED: Final = """
Masks count in the order of their objects' scores times the quality that the network expects of each; both are in what
a detector publishes. In the order of the scores alone their mAP50 and mAP50-95 are {by_score}. As the model makes
them, without that network, they are {coarse}.
"""


@dataclass(frozen=True, slots=True)
class SimulatorFigures:
    """Evaluation results on unseen scenes of the simulator; `lists` at `CONFIDENCE`.

    unrefined: of all masks as they are without a refiner, where there is one.
    """

    masks: MaskFigures
    lists: ListFigures
    near: NearFigures
    unrefined: Precision | None = None


@dataclass(frozen=True, slots=True)
class Figures:
    """A run's weights and their evaluation results.

    classes: by number. architecture: the name of its YAML. task: in Ultralytics' words.
    simulated: of a model that knows all that the simulator has. photographs: by source. licences: of the sources
    trained on, in words.
    """

    classes: Sequence[str]
    architecture: str
    task: str
    simulated: SimulatorFigures | None
    photographs: Mapping[str, PhotographScore] = field(default_factory=dict)
    licences: Mapping[str, str] = field(default_factory=dict)


def model_card(
    settings: TrainingSettings, figures: Figures, effort: Effort, refined: int = 0, made: MadePictures = NONE_MADE
) -> str:
    """Describe a run's weights as Markdown. refined: number of objects a refiner of masks learned from, if any."""
    values = settings.model_dump()
    own = _seen(settings) + _WORLDS_LIMITS
    drawn = bool(numbers_of(figures.classes, settings.class_names))
    images = f"{settings.images} images of 640x480, two of each scene, " if drawn else ""
    return _CARD.format(
        name=settings.output.stem,
        names=", ".join(figures.classes),
        kind=_kind(figures),
        architecture=figures.architecture,
        count=len(figures.classes),
        command=_command(settings),
        origin=_origin(settings, drawn=drawn),
        rendered="" if settings.only_refiner else f"; {images}batch {settings.batch}",
        scratch="" if settings.start else _FROM_SCRATCH.format(**values),
        mixed=_mixed(settings, made, drawn=drawn) if settings.data and not settings.only_refiner else "",
        averaged=_AVERAGED.format(**values) if settings.keep else "",
        limits=own if tuple(figures.classes) == CLASSES else _OTHER_LIMITS,
        simulated="" if figures.simulated is None else _simulated(settings, figures.simulated),
        photographs=_photographs(figures),
        wall_min=effort.wall_s / 60,
        cpu_min=effort.cpu_s / 60,
        python=platform.python_version(),
        versions=", ".join(f"{name} {version(name)}" for name in PACKAGES),
        device=device_name(settings),
        refiner=_REFINER.format(objects=refined, **values) if refined else "",
        **settings.model_dump(include={"seed", "imgsz", "workers"}),
    )


def _kind(figures: Figures) -> str:
    finds = "instance segmentation" if figures.task == "segment" else "detection"
    return f"A nano {finds} model" if figures.architecture == ARCHITECTURE else f"A model for {finds}"


def _simulated(settings: TrainingSettings, figures: SimulatorFigures) -> str:
    """Describe how weights do on unseen scenes of the simulator."""
    masks, lists, near = figures.masks, figures.lists, figures.near
    seeds = held_out_seeds(settings.seed, settings.holdout)
    return _SIMULATED.format(
        holdout=settings.holdout,
        first=seeds[0],
        last=seeds[-1],
        area=MIN_AREA,
        visibility=MIN_VISIBILITY,
        mask_rows="\n".join(_mask_row(*row) for row in [*masks.per_class.items(), ("all", masks.overall)]),
        size_rows="\n".join(_mask_row(*row) for row in masks.per_size.items()),
        exact=lists.share,
        required=REQUIRED_AREA,
        visible=VISIBLE_AREA,
        list_rows="\n".join(_row(name, lists.missed.get(name, 0), lists.invented.get(name, 0)) for name in CLASSES),
        near_area=NEAR_AREA,
        near_metres=NEAR_METRES,
        near_share=near.share,
        pictures=near.pictures,
        iou=MATCHING_IOU,
        confidence=CONFIDENCE,
        unrefined=_without(masks.by_score, figures.unrefined),
        near_rows="\n".join(_near_row(near, name) for name in CLASSES),
    )


def _seen(settings: TrainingSettings) -> str:
    """Say on which photographs a model was trained."""
    if settings.only_refiner and settings.start is not None:
        return _AS_BEFORE.format(start=settings.start.name)
    return _SEEN if settings.data else _UNSEEN


def _origin(settings: TrainingSettings, *, drawn: bool) -> str:
    if settings.only_refiner and settings.start is not None:
        return f"that of {settings.start.name} but for what refines its masks"
    begin = "from random weights" if settings.start is None else f"from {settings.start.name}"
    pictures = ["rendered pictures of simulated warehouses"] * drawn + ["photographs"] * bool(settings.data)
    return f"trained {begin} on {' and on '.join(pictures)}"


def _mixed(settings: TrainingSettings, made: MadePictures, *, drawn: bool) -> str:
    return _MIXED.format(
        together="these together with photographs, in about equal parts" if drawn else "photographs",
        data_epochs=settings.data_epochs,
        data_rate=settings.data_rate,
        empty_repeats=EMPTY_REPEATS,
        made=_made(made),
    )


def _command(settings: TrainingSettings) -> str:
    """Return the command line; of folders and files only their names, which are the same on any machine."""
    given = settings.model_dump(include=DECISIVE, exclude_defaults=True, by_alias=True)
    options = [
        (name, each) for name, value in given.items() for each in (value if isinstance(value, list) else [value])
    ]
    texts = (f"--{name.replace('_', '-')} {_argument(each)}".rstrip() for name, each in options)
    return " ".join(["fleetsight train", *texts])


def _argument(value: object) -> str:
    if isinstance(value, dict):
        return shlex.quote(",".join(f"{old}={new}" for old, new in value.items()))
    return value.name if isinstance(value, Path) else "" if value is True else str(value)


def _photographs(figures: Figures) -> str:
    if not figures.photographs:
        return ""
    rows = [row for source, score in sorted(figures.photographs.items()) for row in _photograph_rows(source, score)]
    lines = [f"- `{source}`: {licence}\n" for source, licence in sorted(figures.licences.items())]
    licences = f"\nThe photographs' sources and their licences as stated there:\n\n{''.join(lines)}" if lines else ""
    summary = _in_words(figures.photographs["all"])
    return _PHOTOGRAPHS.format(summary=summary, iou=MATCHING_IOU, rows="\n".join(rows), licences=licences)


def _in_words(score: PhotographScore) -> str:
    """Say in one sentence what a model does on real pictures."""
    found = ", ".join(
        f"{_share(each.recall)} of {each.labelled} labelled objects of the class {name} (precision"
        f" {_share(each.precision)})"
        for name, each in score.classes.items()
        if each.labelled
    )
    rate = score.false_alarms_per_picture
    alarms = "" if rate is None else f", with {rate:.2f} false alarms in a picture where none of the classes is"
    return textwrap.fill(f"On {score.pictures} real pictures it found {found or 'nothing to find'}{alarms}.", 120)


def _photograph_rows(source: str, score: PhotographScore) -> Iterator[str]:
    for name, each in score.classes.items():
        if each.labelled:
            yield _row(source, score.pictures, name, each.labelled, _average(each.recall), _average(each.precision), "")
    if score.empty_pictures:
        yield _row(source, score.empty_pictures, "none", "", "", "", f"{score.false_alarms_per_picture:.2f}")


def _without(by_score: Precision, unrefined: Precision | None) -> str:
    """Describe the precision of masks in another order, and without the refiner; empty without one."""
    if unrefined is None:
        return ""
    orders = {"by_score": by_score, "coarse": unrefined}
    return _UNREFINED.format(**{name: " and ".join(map(_average, _averages(each))) for name, each in orders.items()})


def _near_row(near: NearFigures, name: str) -> str:
    return _row(name, *(counts.get(name, 0) for counts in (near.objects, near.named, near.misnamed, near.invented)))


def _mask_row(name: str, precision: Precision) -> str:
    return _row(name, precision.truths, *map(_average, _averages(precision)))


def _averages(precision: Precision) -> tuple[float | None, float | None]:
    return precision.map50, precision.map50_95


def _average(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _made(made: MadePictures) -> str:
    return _MADE.format(collages=made.collages, plain=made.plain) if made != NONE_MADE else ""
