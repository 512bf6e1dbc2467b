import msgspec
import numpy as np
import pytest
import simplejpeg

from schemas.detections import Box, Detection, Detections, Keypoint, Mask, RotatedBox
from schemas.image import ImageFrame
from services.detector.overlay import Picture, caption, color_of, drawings, overlays
from services.detector.runtime.masks import encode_all
from services.detector.runtime.object_shapes import corners_of
from services.geometry.errors import MaskError
from services.geometry.masks import Window
from tests.services.detector.support.requests import frame_of

HEIGHT, WIDTH = 120, 160


def detection(box: Box, *, label: int = 0, track: int | None = None) -> Detection:
    wide, high = int(box.x2 - box.x1), int(box.y2 - box.y1)
    (mask,) = encode_all([Window(int(box.y1), int(box.x1), np.ones((high, wide), np.bool_))], HEIGHT, WIDTH)
    return Detection(name="box", score=0.876, box=box, mask=mask, label=label, track=track)


INSIDE = detection(Box(40, 50, 100, 90))


def found(*objects: Detection, frame: ImageFrame) -> Detections:
    return Detections(header=frame.header, height=HEIGHT, width=WIDTH, objects=list(objects), model="fake", worker="w1")


def grey() -> Picture:
    return np.full((HEIGHT, WIDTH, 3), 128, np.uint8)


def draw(picture: Picture, objects: list[Detection], *, masks: bool) -> Picture:
    (drawn,) = drawings(picture, objects, [masks])
    return drawn


def test_a_box_is_drawn_in_its_classes_colour_and_nothing_far_from_it_changes() -> None:
    before = grey()
    drawn = draw(before, [INSIDE], masks=False)
    assert tuple(drawn[70, 40]) == tuple(drawn[90, 70]) == color_of(0)
    assert np.all(drawn[60:80, 50:90] == 128)
    assert np.all(drawn[100:, :] == 128)
    assert np.all(before == 128)


def test_a_rotated_box_is_drawn_as_it_lies() -> None:
    turned = RotatedBox(x=80, y=60, width=60, height=20, angle=np.pi / 4)
    drawn = draw(grey(), [msgspec.structs.replace(INSIDE, rotated=turned)], masks=False)
    corners = np.rint(corners_of(turned)).astype(int)
    assert {tuple(drawn[y, x]) for x, y in corners} == {color_of(0)}
    assert tuple(drawn[60, 80]) == (128, 128, 128)
    assert tuple(drawn[90, 100]) == (128, 128, 128)  # a corner of the upright box


def test_keypoints_are_drawn_where_they_are_in_view_and_joined_if_they_are_a_persons() -> None:
    points = [Keypoint(20 + 8 * n, 100, 0.9 if n != 9 else 0.4) for n in range(17)]
    drawn = draw(grey(), [msgspec.structs.replace(INSIDE, keypoints=points)], masks=False)
    assert [tuple(drawn[100, int(each.x)]) == (255, 255, 255) for each in points] == [n != 9 for n in range(17)]
    assert tuple(drawn[100, 64]) == color_of(0)  # between the shoulders, 5 and 6
    others = draw(grey(), [msgspec.structs.replace(INSIDE, keypoints=points[:16])], masks=False)
    assert tuple(others[100, 64]) == (128, 128, 128)


def test_a_mask_tints_what_it_covers() -> None:
    drawn = draw(grey(), [INSIDE], masks=True)
    tinted = 0.55 * 128 + 0.45 * np.array(color_of(0))
    assert np.allclose(drawn[70, 70], tinted, atol=1)
    assert np.all(drawn[70, 110] == 128)


@pytest.mark.parametrize(
    "place",
    [(slice(0, 1), slice(0, 1)), (slice(119, 120), slice(0, 160)), (slice(0, 120), slice(7, 8)), (slice(0), slice(0))],
)
def test_exactly_the_pixels_of_a_mask_are_tinted(place: tuple[slice, slice]) -> None:
    inside = np.zeros((HEIGHT, WIDTH), np.bool_)
    inside[place] = True
    (mask,) = encode_all([Window(0, 0, inside)], HEIGHT, WIDTH)
    plain = msgspec.structs.replace(INSIDE, mask=mask)
    before = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    tinted, framed = (draw(before, [plain], masks=masks) for masks in (True, False))
    expected = before[inside] * 0.55 + 0.45 * np.array(color_of(0))
    unframed = (framed == before).all(axis=2)
    assert np.allclose(tinted[inside & unframed], expected[unframed[inside]], atol=1)
    assert np.array_equal(tinted[~inside], framed[~inside])


def test_captions_of_the_same_box_are_below_one_another() -> None:
    whole = [msgspec.structs.replace(detection(Box(0, 0, 160, 120), label=label), mask=None) for label in range(3)]
    all_three, best = draw(grey(), whole, masks=False), draw(grey(), whole[:1], masks=False)
    below = [{tuple(pixel) for pixel in all_three[:60, 2]} & {color_of(label)} for label in range(3)]
    assert all(below)
    assert color_of(1) not in {tuple(pixel) for pixel in best[:60, 2]}


def test_captions_stay_in_the_picture() -> None:
    corners = [Box(0, 0, 10, 10), Box(150, 0, 160, 10), Box(150, 110, 160, 120), Box(0, 0, 160, 120)]
    for box in corners:
        drawn = draw(grey(), [detection(box)], masks=False)
        assert np.count_nonzero(drawn.min(axis=2) > 180) > 10, box


def test_a_caption_says_name_score_and_the_number_of_a_track() -> None:
    assert caption(INSIDE) == "box 0.88"
    assert caption(msgspec.structs.replace(INSIDE, track=(77 << 20) | 5)) == "box 0.88 #5"


def test_classes_have_colours_of_their_own() -> None:
    assert len({color_of(label) for label in range(80)}) == 80


def test_an_overlay_is_a_jpeg_with_the_frames_header_and_colours() -> None:
    frame = frame_of(np.full((HEIGHT, WIDTH, 3), (200, 30, 10), np.uint8), "rgb8", seq=7)
    (drawn,) = overlays(found(INSIDE, frame=frame), frame, [True])
    assert (drawn.header, drawn.format, drawn.encoding) == (frame.header, "jpeg", "rgb8")
    assert (drawn.height, drawn.width, drawn.step) == (HEIGHT, WIDTH, WIDTH * 3)
    assert np.allclose(simplejpeg.decode_jpeg(drawn.data)[110, 150], (200, 30, 10), atol=6)


def test_the_smallest_and_the_grey_can_be_drawn_over() -> None:
    dot = ImageFrame(
        header=frame_of(grey()).header, height=1, width=1, encoding="mono8", step=1, data=memoryview(b"\x80")
    )
    everything = Detection(name="box", score=1, box=Box(0, 0, 1, 1))
    seen = Detections(header=dot.header, height=1, width=1, objects=[everything], model="fake", worker="w1")
    (drawn,) = overlays(seen, dot, [True])
    assert simplejpeg.decode_jpeg(drawn.data).shape == (1, 1, 3)


def test_overlays_made_together_are_those_made_alone() -> None:
    frame = frame_of(np.random.default_rng(2).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8))
    seen = found(INSIDE, detection(Box(70, 60, 130, 100), label=1, track=3), frame=frame)
    alone = [next(overlays(seen, frame, [masks])).data for masks in (True, False)]
    assert [made.data for made in overlays(seen, frame, [True, False])] == alone


def test_what_is_surer_is_tinted_last() -> None:
    surer, other = detection(Box(40, 50, 100, 90)), detection(Box(70, 60, 130, 100), label=1)
    under = grey()[0, 0] * 0.55 + np.array(color_of(1)) * 0.45
    drawn = draw(grey(), [surer, other], masks=True)
    assert np.allclose(drawn[80, 90], under * 0.55 + np.array(color_of(0)) * 0.45, atol=2)


def test_a_damaged_mask_is_an_error_where_masks_are_drawn() -> None:
    damaged = msgspec.structs.replace(INSIDE, mask=Mask((HEIGHT, WIDTH), "1"))
    assert draw(grey(), [damaged], masks=False).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(MaskError):
        draw(grey(), [INSIDE, damaged], masks=True)
