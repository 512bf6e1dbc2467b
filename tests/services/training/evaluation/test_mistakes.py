import base64
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import cv2
import numpy as np

from schemas.detections import Detection
from services.training.evaluation.mistakes import LABEL, NOTHING, PREDICTION, WIDTH, Mistakes, pairs
from services.training.evaluation.photographs import score_photographs
from services.training.photographs import Photograph
from tests.services.training.evaluation.test_photographs import (
    BOX,
    EVERY,
    FORKLIFT,
    PALLET,
    found,
    labelled,
    picture,
)

GREY = np.full((200, 100, 3), 128, np.uint8)


def paired(photograph: Photograph, *detections: Detection) -> list[tuple[str | None, str | None]]:
    found_in_it = pairs(photograph, detections, 100, 200)
    return [(each.labelled, None if each.predicted is None else each.predicted.name) for each in found_in_it]


def test_a_prediction_goes_to_the_label_of_its_class_before_a_nearer_one_of_another() -> None:
    both = picture(labelled(BOX, 0, 0, 0.5, 0.5), labelled(PALLET, 0, 0, 0.5, 0.55))
    assert paired(both, found("pallet", 0, 0, 50, 100), found("box", 0, 0, 50, 100)) == [
        ("pallet", "pallet"),
        ("box", "box"),
    ]
    assert paired(both, found("forklift", 0, 0, 50, 100)) == [("box", "forklift"), ("pallet", None)]


def test_of_several_predictions_of_one_object_the_first_is_right() -> None:
    one = picture(labelled(BOX, 0, 0, 0.5, 0.5))
    assert paired(one, found("box", 0, 0, 50, 100), found("box", 0, 0, 50, 99)) == [("box", "box"), (None, "box")]


def test_a_prediction_alone_of_a_class_that_is_not_labelled_is_left_out() -> None:
    only_boxes = picture(labelled=frozenset({BOX}), absent=frozenset({FORKLIFT}))
    alone = [found(name, 0, 0, 9, 9) for name in ("box", "pallet", "forklift")]
    assert paired(only_boxes, *alone) == [(None, "box"), (None, "forklift")]


def page_of(mistakes: Mistakes, *photographs: Photograph) -> ET.Element:
    """Return the page's body as a tree, which fails where a tag is not closed."""
    page = mistakes.page("site <seg>", score_photographs(photographs, lambda _: [], lambda _: None))
    body = page[page.index("<body>") : page.index("</html>")]
    return ET.fromstring(re.sub(r"(<img[^>]*)>", r"\1/>", body))  # noqa: S314 - written here


def written(tmp_path: Path, name: str) -> Photograph:
    file = tmp_path / name
    cv2.imwrite(str(file), GREY)
    return Photograph(file, "yard", (labelled(BOX, 0, 0, 0.5, 0.5),))


def test_the_page_has_figures_confusion_and_what_was_wrong_in_pictures(tmp_path: Path) -> None:
    mistakes, photograph = Mistakes(), written(tmp_path, "yard_<1>.png")
    mistakes.add(photograph, GREY, [found("box", 0, 0, 50, 100), found("forklift", 60, 60, 90, 90, score=0.31)])
    mistakes.add(photograph, GREY, [found("pallet", 0, 0, 50, 100)])
    mistakes.add(photograph, GREY, [])
    body = page_of(mistakes, photograph)
    assert body.findtext("h1") == "site <seg>: mistakes on photographs"
    figures, confusion = ([["".join(cell.itertext()) for cell in row] for row in table] for table in body.iter("table"))
    assert figures[1:] == [["all", "box", "1", "0%", "-"], ["yard", "box", "1", "0%", "-"]]
    assert dict(zip(confusion[0], confusion[1], strict=True)) == {
        "labelled as": "box",
        "predicted box": "1",
        "predicted pallet": "1",
        "predicted forklift": "0",
        "predicted nothing": "1",
    }
    assert confusion[-1] == [NOTHING, "0", "0", "1", ""]
    said = [each.text for each in body.iter("figcaption")]
    assert said == [
        "yard_<1>.png: 1 x forklift where nothing is",
        "yard_<1>.png: 1 x pallet where box is",
        "yard_<1>.png: 1 x box missed",
    ]


def test_mistakes_alone_are_drawn_each_kind_in_its_colour(tmp_path: Path) -> None:
    mistakes, photograph = Mistakes(), written(tmp_path, "yard_1.png")
    mistakes.add(photograph, GREY, [found("forklift", 60, 120, 90, 180)])
    mistakes.add(photograph, GREY, [found("box", 0, 0, 50, 100)])
    (image,) = page_of(mistakes, photograph).iter("img")
    data = base64.b64decode(image.attrib["src"].partition(",")[2])
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    shown = cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)
    assert shown.shape == (2 * WIDTH, WIDTH, 3)
    for (left, top, right, bottom), colour in (((0, 0, 50, 100), LABEL), ((60, 120, 90, 180), PREDICTION)):
        edge = shown[round((top + bottom) / 2 * WIDTH / 100), round(right * WIDTH / 100)]
        assert np.abs(edge.astype(int) - colour).max() < 60, (left, colour)


def test_the_worst_pictures_are_kept_and_no_others(tmp_path: Path) -> None:
    mistakes = Mistakes(shown=2)
    for wrong in (1, 3, 0, 2, 3):
        alarms = [found("pallet", 10 * place, 0, 10 * place + 9, 9) for place in range(wrong)]
        empty = Photograph(Path(f"yard_{wrong}.jpg"), "yard", (), EVERY)
        mistakes.add(empty, GREY, alarms)
    captions = [each.text for each in page_of(mistakes, written(tmp_path, "yard_1.png")).iter("figcaption")]
    assert captions == ["yard_3.jpg: 3 x pallet where nothing is"] * 2
    assert mistakes.confusion == {(NOTHING, "pallet"): 9}


def test_without_mistakes_the_page_says_so(tmp_path: Path) -> None:
    photograph = written(tmp_path, "yard_1.png")
    mistakes = Mistakes()
    mistakes.add(photograph, GREY, [found("box", 0, 0, 50, 100)])
    body = page_of(mistakes, photograph)
    assert [each.text for each in body.iter("p")][-1] == "It made no mistake in them."
