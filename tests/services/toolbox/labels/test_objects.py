import cv2
import numpy as np
import pytest

from services.toolbox.labels.objects import LabelsError, box_of, file_name, object_of, parts_of

SIZE = (100, 50)


def test_corners_out_of_the_picture_are_clipped() -> None:
    found = object_of("box", [(-10, -10), (150, 10), (50, 60)], SIZE, "")
    assert found.polygon.tolist() == [[0, 0], [1, 0.2], [0.5, 1]]


def test_a_small_object_is_one_and_a_line_is_none() -> None:
    assert len(object_of("box", [(0, 0), (1, 0), (0, 1)], (4000, 3000), "").polygon) == 3
    for line in ([(0, 0), (10, 10), (50, 50)], [(5, 5)] * 4, [(3, 0), (3, 9), (3, 4)], [(101, 0), (200, 0), (150, 9)]):
        with pytest.raises(LabelsError, match="here: box has no area within the picture"):
            object_of("box", line, SIZE, "here")


@pytest.mark.parametrize("name", ["", "a" * 257, "a\nb", "\x1b[31m"])
def test_names_of_classes_are_short_and_printable(name: str) -> None:
    with pytest.raises(LabelsError, match="here: not the name of a class, which is 1 to 256 printable characters: "):
        object_of(name, [(0, 0), (1, 0), (0, 1)], SIZE, "here")


def test_a_box_that_is_turned_by_a_right_angle_covers_what_it_says() -> None:
    found = box_of("box", (40, 20, 20, 10), SIZE, "", turned=90)
    assert (found.polygon * SIZE).min(axis=0) == pytest.approx([45, 15])
    assert (found.polygon * SIZE).max(axis=0) == pytest.approx([55, 35])


def test_parts_are_joined_to_one_polygon_that_covers_them_all() -> None:
    parts = [
        [(0, 0), (20, 0), (20, 20), (0, 20)],
        [(60, 10), (90, 10), (90, 40), (60, 40)],
        [(5, 30), (25, 30), (9, 45)],
    ]
    found = parts_of("box", parts, SIZE, "")
    covered = cv2.fillPoly(np.zeros((51, 101), np.uint8), [np.round(found.polygon * SIZE).astype(np.int32)], 1)
    apart = cv2.fillPoly(np.zeros((51, 101), np.uint8), [np.array(part, np.int32) for part in parts], 1)
    assert not (apart > covered).any()
    assert covered.sum() - apart.sum() < 120  # the cuts, a pixel wide


def test_names_of_pictures_are_the_ends_of_paths() -> None:
    for path in ("a ü.jpg", "/data/a ü.jpg", "C:\\data\\a ü.jpg", "../../a ü.jpg", "x/../a ü.jpg", "./a ü.jpg"):
        assert file_name(path, "") == "a ü.jpg"
    for path in ("", "/", "..", "x/..", "a\n.jpg", "."):
        with pytest.raises(LabelsError, match=r"here: .* names no picture"):
            file_name(path, "here")
