from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.training.collages import MOST_OBJECTS, SOURCE, make_collages, make_plain
from services.training.files import TrainingError
from services.training.photographs import LabelledObject, Photograph

BOX, PALLET, FORKLIFT = range(3)
RED = (30, 30, 220)
SQUARE = np.array([(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)])


def picture(file: Path, *, colour: tuple[int, int, int] = (90, 120, 90), square: tuple[int, int, int] = RED) -> Path:
    """A textured picture of 200 x 160 pixels, a disc in the middle of it."""
    random = np.random.default_rng(1)
    image = np.full((160, 200, 3), colour, np.float64) + random.normal(0, 12, (160, 200, 3))
    drawn = image.clip(0, 255).astype(np.uint8)
    cv2.ellipse(drawn, (100, 80), (50, 40), 0, 0, 360, square, -1)
    cv2.imwrite(str(file), drawn)
    return file


@pytest.fixture
def empty(tmp_path: Path) -> Photograph:
    file = tmp_path / "empty.png"
    cv2.imwrite(str(file), np.full((240, 320, 3), (200, 60, 60), np.uint8))
    return Photograph(file, "garden", ())


def red(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Pixels nearer to RED than to a background, in any light that a collage gives them."""
    blue, _, red_channel = np.moveaxis(image.astype(int), 2, 0)
    return np.asarray(red_channel > blue + 60)


def made(pictures: list[Photograph]) -> Iterator[tuple[Photograph, NDArray[np.uint8]]]:
    for each in pictures:
        image = cv2.imread(str(each.file))
        assert image is not None
        yield each, np.asarray(image, np.uint8)


def test_objects_are_where_their_labels_say(tmp_path: Path, empty: Photograph) -> None:
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    disc = np.stack([0.5 + 0.25 * np.cos(angles), 0.5 + 0.25 * np.sin(angles)], axis=1)
    source = Photograph(picture(tmp_path / "a.png"), "yard", (LabelledObject(BOX, disc),))
    for collage, image in made(make_collages(tmp_path / "made", [source, empty], 12, seed=1)):
        height, width = image.shape[:2]
        labelled = np.zeros((height, width), np.uint8)
        for each in collage.objects:
            cv2.fillPoly(labelled, [(each.polygon * (width, height)).round().astype(np.int32)], 1)
        assert 1 <= len(collage.objects) <= MOST_OBJECTS
        assert not collage.unknown
        covered = red(image)
        assert (covered & (labelled == 1)).sum() > 0.93 * (covered | (labelled == 1)).sum()


def test_an_outline_is_found_where_a_box_alone_is_known(tmp_path: Path, empty: Photograph) -> None:
    boxed = LabelledObject(FORKLIFT, SQUARE, box_only=True)
    source = Photograph(picture(tmp_path / "a.png"), "yard", (boxed,), unknown=frozenset({BOX, PALLET}))
    for collage, image in made(make_collages(tmp_path / "made", [source, empty], 6, seed=1)):
        assert all(each.box_only for each in collage.objects)
        assert collage.unknown == {BOX, PALLET}, "it may show these, too"
        height, width = image.shape[:2]
        for left, top, right, bottom in (each.box for each in collage.objects):
            part = red(image)[round(top * height) : round(bottom * height), round(left * width) : round(right * width)]
            assert part.mean() == pytest.approx(np.pi / 4, abs=0.08), "the disc, without the corners of its box"


def test_objects_do_not_cover_each_other_and_no_class_is_rare(tmp_path: Path, empty: Photograph) -> None:
    sources = [
        Photograph(picture(tmp_path / "a.png"), "yard", (LabelledObject(BOX, SQUARE),) * 9),
        Photograph(picture(tmp_path / "b.png"), "yard", (LabelledObject(PALLET, SQUARE),)),
    ]
    collages = make_collages(tmp_path / "made", [*sources, empty], 60, seed=1)
    counts = [sum(each.class_index == wanted for collage in collages for each in collage.objects) for wanted in (0, 1)]
    assert min(counts) > 0.7 * max(counts)
    for collage in collages:
        boxes = [each.box for each in collage.objects]
        for number, (left, top, right, bottom) in enumerate(boxes):
            assert 0 <= left < right <= 1
            assert 0 <= top < bottom <= 1
            assert not any(left < b[2] and b[0] < right and top < b[3] and b[1] < bottom for b in boxes[:number])


def test_the_same_seed_makes_the_same_pictures(tmp_path: Path, empty: Photograph) -> None:
    source = Photograph(picture(tmp_path / "a.png"), "yard", (LabelledObject(BOX, SQUARE, box_only=True),))
    first, second, other = (
        [
            each.file.read_bytes()
            for each in [
                *make_collages(tmp_path / name, [source, empty], 3, seed),
                *make_plain(tmp_path / name, 3, seed),
            ]
        ]
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert first == second
    assert not set(first) & set(other)


def test_without_backgrounds_or_objects_there_are_none(tmp_path: Path, empty: Photograph) -> None:
    source = Photograph(picture(tmp_path / "a.png"), "yard", (LabelledObject(BOX, SQUARE),))
    assert make_collages(tmp_path / "made", [source], 3, seed=1) == []
    assert make_collages(tmp_path / "made", [empty], 3, seed=1) == []


def test_objects_too_small_to_cut_out_are_left(tmp_path: Path, empty: Photograph) -> None:
    small = LabelledObject(BOX, SQUARE * 0.1)
    source = Photograph(picture(tmp_path / "a.png"), "yard", (small,))
    (collage,) = make_collages(tmp_path / "made", [source, empty], 1, seed=1)
    assert collage.source == SOURCE
    assert collage.empty


def test_plain_pictures_are_empty_and_some_nearly_black(tmp_path: Path) -> None:
    pictures = make_plain(tmp_path / "made", 30, seed=1)
    assert all(each.empty for each in pictures)
    brightness = [image.mean() for _, image in made(pictures)]
    assert sum(value < 30 for value in brightness) >= 10
    assert max(brightness) > 100


def test_a_picture_that_cannot_be_read_is_named(tmp_path: Path, empty: Photograph) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no picture")
    for file, reason in ((broken, "not a picture that can be read"), (tmp_path / "gone.jpg", "No such file")):
        source = Photograph(file, "yard", (LabelledObject(BOX, SQUARE),))
        with pytest.raises(TrainingError, match=f"{file.name}: {reason}"):
            make_collages(tmp_path / "made", [source, empty], 1, seed=1)
