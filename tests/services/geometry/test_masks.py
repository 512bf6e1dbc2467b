from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from schemas.detections import Mask
from services.geometry.errors import MaskError
from services.geometry.masks import MAX_PIXELS, Window, decode, decode_all, eroded
from services.geometry.runs import Runs
from tests.schemas.masks import coco_mask


def whole(window: Window, height: int, width: int) -> NDArray[Any]:
    made = np.zeros((height, width), np.bool_)
    made[window.place] = window.pixels
    return made


shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))


@given(pixels=shapes.flatmap(lambda shape: arrays(np.bool_, shape)))
def test_what_pycocotools_encodes_is_decoded_and_its_window_is_tight(pixels: NDArray[Any]) -> None:
    window = decode(coco_mask(pixels))
    assert (whole(window, *pixels.shape) == pixels).all()
    assert window.area == pixels.sum()
    columns = np.flatnonzero(pixels.any(axis=0))
    if len(columns):
        assert (window.left, window.pixels.shape[1]) == (columns[0], columns[-1] - columns[0] + 1)


def test_a_blob_has_no_rows_to_spare() -> None:
    pixels = np.zeros((20, 30), np.bool_)
    pixels[4:9, 6:10] = True
    window = decode(coco_mask(pixels))
    assert (window.top, window.left, window.pixels.shape) == (4, 6, (5, 4))
    assert window.place == (slice(4, 9, 1), slice(6, 10, 1))


def test_a_mask_without_pixels_is_an_empty_window() -> None:
    window = decode(coco_mask(np.zeros((3, 4), np.bool_)))
    assert (window.area, window.pixels.shape) == (0, (0, 0))
    assert eroded(window, 1) is window


@pytest.mark.parametrize(
    ("counts", "reason"),
    [
        ("", "not encoded"),
        ("ü", "not ASCII"),
        ("0", "runs of 0 pixels, the mask has 12"),
        ("=", "runs of 13 pixels, the mask has 12"),
        ("P", "not encoded"),
        (" ", "not encoded"),
        ("~", "not encoded"),
        ("O", "negative length"),
        ("PPPPPPPPPPPPPPPPPPPP1", "longer than any image"),
    ],
)
def test_runs_that_are_no_mask(counts: str, reason: str) -> None:
    with pytest.raises(MaskError, match=reason):
        decode(Mask((3, 4), counts))


@given(counts=st.text(st.characters(min_codepoint=40, max_codepoint=120), max_size=30))
def test_any_text_is_a_mask_of_the_size_or_refused(counts: str) -> None:
    try:
        window = decode(Mask((5, 7), counts))
    except MaskError:
        return
    assert whole(window, 5, 7).shape == (5, 7)


def test_edges_are_taken_off_at_holes_and_at_the_images_border_too() -> None:
    pixels = np.ones((7, 9), np.bool_)
    pixels[3, 4] = False
    inner = eroded(Window(0, 0, pixels), 1)
    expected = np.zeros((7, 9), np.bool_)
    expected[1:-1, 1:-1] = True
    expected[2:5, 3:6] = False
    assert (inner.pixels == expected).all()
    assert (eroded(Window(0, 0, pixels), 0).pixels == pixels).all()


def test_many_masks_are_decoded_as_each_alone_and_what_is_wrong_with_one_is_its_own() -> None:
    pictures = np.random.default_rng(0).random((5, 6, 8)) < np.array([0.2, 0.5, 0, 0.9, 0.1])[:, None, None]
    masks = [coco_mask(pixels) for pixels in pictures]
    masks += [Mask((6, 8), "="), coco_mask(np.ones((2, 3), np.bool_)), *masks[:2]]
    for margin in (0, 2):
        for mask, found in zip(masks, decode_all(masks, margin=margin), strict=True):
            if isinstance(found, MaskError):
                assert str(found) == "runs of 13 pixels, the mask has 48"
                continue
            alone = decode(mask, margin=margin)
            assert (found.top, found.left) == (alone.top, alone.left)
            assert np.array_equal(found.pixels, alone.pixels)
    assert sum(isinstance(found, MaskError) for found in decode_all(masks)) == 1


def test_none_are_decoded_from_none() -> None:
    assert not list(decode_all([]))


def test_a_margin_ends_at_the_images_border() -> None:
    pixels = np.zeros((6, 8), np.bool_)
    pixels[1, 5:] = True
    window = decode(coco_mask(pixels), margin=2)
    assert (window.top, window.left, window.pixels.shape) == (0, 3, (4, 5))
    assert np.array_equal(window.pixels, pixels[:4, 3:])


def test_a_large_window_keeps_every_nth_row_and_column_and_a_margin_of_these() -> None:
    pixels = np.zeros((60, 90), np.bool_)
    pixels[20:40, 30:80:2] = True
    small = np.zeros_like(pixels)
    small[3:5, 3:5] = True
    large, whole_one = decode_all([coco_mask(pixels), coco_mask(small)], margin=2, each=400)
    assert isinstance(large, Window)
    assert large.step == 3  # a window of 36 x 65 pixels with its margin of 8
    assert np.array_equal(pixels[large.place], large.pixels)
    assert large.pixels.size <= 400
    assert isinstance(whole_one, Window)
    assert (whole_one.step, whole_one.area) == (1, 4)
    assert np.array_equal(eroded(large, 3).pixels, eroded(Window(0, 0, large.pixels), 1).pixels)


def all_of(height: int, width: int) -> Mask:
    """Return the mask that covers an image, in nine characters at most."""
    return coco_mask(np.ones((height, width), np.bool_))


def test_few_characters_do_not_stand_for_gigabytes() -> None:
    covering = all_of(4096, 4096)
    assert len(covering.counts) < 10
    windows = pixels = 0
    for found in decode_all([covering] * 1000, margin=2):
        if isinstance(found, Window):
            windows, pixels = windows + 1, pixels + found.pixels.size
        else:
            assert "over 134 million pixels" in str(found)
    assert (windows, pixels) == (8, MAX_PIXELS)


def test_of_masks_together_those_are_left_out_that_do_not_fit_beside_the_ones_before() -> None:
    pixels = np.zeros((6, 8), np.bool_)
    pixels[2:4, 3:7] = True
    small, large = coco_mask(pixels), all_of(6, 8)
    found = list(decode_all([small, large, coco_mask(np.zeros((6, 8), np.bool_)), small, small], most=20))
    sizes = [each.pixels.size if isinstance(each, Window) else None for each in found]
    assert sizes == [8, None, 0, 8, None]
    for each in (found[0], found[3]):
        assert isinstance(each, Window)
        assert np.array_equal(whole(each, 6, 8), pixels)


def test_masks_without_room_are_not_decoded_in_small_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    runs_of = Mock(side_effect=Runs.of)
    monkeypatch.setattr(Runs, "of", runs_of)
    assert len(list(decode_all([all_of(4096, 4096)] * 50, most=1 << 24))) == 50
    assert runs_of.call_count == 1


def test_one_mask_alone_can_be_too_large_and_small_ones_after_it_are_decoded() -> None:
    height = width = 16_384
    large = Mask((height, width), "0PPPPP8")
    with pytest.raises(MaskError, match="million pixels"):
        decode(large)
    refused, small = decode_all([large, all_of(2, 3)])
    assert isinstance(refused, MaskError)
    assert isinstance(small, Window)
    assert small.area == 6
