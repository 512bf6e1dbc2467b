"""Pictures that are collected: likeness, labels, and what is made unrecognisable."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection, Detections, Mask
from schemas.image import ImageFrame
from services.toolbox.collect.pictures import blurred, fingerprint, labels, picture_of
from tests.schemas.frames import header, image
from tests.schemas.masks import coco_mask
from tests.schemas.pictures import compressed, file_of

HEIGHT, WIDTH = 60, 80


def textured(seed: int) -> NDArray[np.uint8]:
    """Return blotches as of a real scene."""
    small = np.random.default_rng(seed).integers(0, 256, (6, 8, 3), np.uint8)
    return np.asarray(cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC), np.uint8)


def frame_of(pixels: NDArray[np.uint8]) -> ImageFrame:
    data = memoryview(pixels.tobytes())
    return ImageFrame(header=header(), height=HEIGHT, width=WIDTH, encoding="bgr8", step=3 * WIDTH, data=data)


def found(*objects: Detection) -> Detections:
    return Detections(header=header(), height=HEIGHT, width=WIDTH, objects=list(objects), model="m", worker="w")


def test_pictures_that_look_alike_differ_in_few_bits() -> None:
    scene = textured(1)
    darker = cv2.convertScaleAbs(scene, alpha=0.8)
    noisy = np.clip(scene + np.random.default_rng(0).normal(0, 4, scene.shape), 0, 255).astype(np.uint8)
    for alike in (darker, noisy):
        assert (fingerprint(scene) ^ fingerprint(np.asarray(alike, np.uint8))).bit_count() <= 4
    assert (fingerprint(scene) ^ fingerprint(textured(2))).bit_count() > 12


def test_a_jpeg_file_stays_as_it_is_and_anything_else_becomes_one() -> None:
    file = file_of(textured(1), ".jpg")
    assert picture_of(compressed(file, "rgb8", 3 * WIDTH, kind="jpeg", height=HEIGHT, width=WIDTH)).file == file
    raw = picture_of(frame_of(textured(1)))
    assert raw.file[:2] == b"\xff\xd8"
    with pytest.raises(ValueError, match="JPEG file"):
        picture_of(compressed(b"\xff\xd8 nothing", "rgb8", 18, kind="jpeg"))


def test_a_label_is_the_outline_of_a_mask() -> None:
    pixels = np.zeros((HEIGHT, WIDTH), np.bool_)
    pixels[10:30, 20:60] = True
    of = found(
        Detection(name="pallet", score=0.9, box=Box(20, 10, 60, 30), mask=coco_mask(pixels)),
        Detection(name="unicorn", score=0.8, box=Box(0, 0, 9, 9)),
    )
    (line,) = labels(of, {"box": 0, "pallet": 1})
    code, *numbers = line.split()
    corners = np.array(numbers, float).reshape(-1, 2) * (WIDTH, HEIGHT)
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(drawn, [np.floor(corners).astype(np.int32)], 1)
    assert code == "1"
    assert np.count_nonzero(drawn & pixels) / np.count_nonzero(drawn | pixels) > 0.95


@pytest.mark.parametrize(
    "mask", [None, Mask((HEIGHT, WIDTH), "damaged"), coco_mask(np.zeros((HEIGHT, WIDTH), np.bool_))]
)
def test_without_a_mask_that_can_be_used_it_is_the_box(mask: Mask | None) -> None:
    of = found(Detection(name="box", score=0.9, box=Box(-8, 30, 40, 60), mask=mask))
    assert list(labels(of, {"box": 0})) == ["0 0.00000 0.50000 0.50000 0.50000 0.50000 1.00000 0.00000 1.00000\n"]


def test_what_is_blurred_is_one_colour_in_patches_and_the_rest_stays() -> None:
    detailed = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    picture = picture_of(frame_of(detailed))
    person = Detection(name="person", score=0.9, box=Box(20.4, 10.2, 60, 50))
    changed = blurred(picture, [person, Detection(name="box", score=0.9, box=Box(0, 0, 9, 9))], ["person"])
    inside = (slice(10, 50), slice(20, 60))
    assert changed.pixels[inside].std() < picture.pixels[inside].std() / 3
    outside = np.ones((HEIGHT, WIDTH), np.bool_)
    outside[inside] = False
    assert np.array_equal(changed.pixels[outside], picture.pixels[outside])
    assert changed.file != picture.file
    assert (changed.blurred, picture.blurred) == (("person",), ())
    assert blurred(picture, [person], ["dog"]) is picture


def test_an_object_beyond_the_picture_hides_nothing_of_it() -> None:
    picture = picture_of(image())
    beyond = Detection(name="person", score=0.9, box=Box(90, 90, 99, 99))
    assert np.array_equal(blurred(picture, [beyond], ["person"]).pixels, picture.pixels)
