"""Floor plans in the format of map_server."""

import io
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from schemas.world import FloorLooks
from services.monitor.map import floor_plan
from services.monitor.map.floor_plan import LOOKED_AT, MOST_CELLS, FloorPlanError, load_floor_plan, looked_at

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
SAID = {"image": "map.pgm", "resolution": "0.5", "origin": "[-3.0, 2.0, 0.0]", "negate": "0"}
THRESHOLDS = {"occupied_thresh": "0.65", "free_thresh": "0.196"}


def hall() -> NDArray[np.uint8]:
    """Six cells across and five up: unknown but for a free floor of 3 x 2, on whose left there is a wall."""
    cells = np.full((5, 6), UNKNOWN, np.uint8)
    cells[1:3, 2:5] = FREE
    cells[1:3, 1] = OCCUPIED
    return cells


def written(folder: Path, pixels: NDArray[np.generic] | None = None, /, **changes: str) -> Path:
    said = {**SAID, **THRESHOLDS, **changes}
    Image.fromarray(hall() if pixels is None else pixels).save(folder / said["image"])
    file = folder / "map.yaml"
    file.write_text("".join(f"{key}: {value}\n" for key, value in said.items() if value), encoding="utf-8")
    return file


def opacity(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))[..., 3]


def test_what_is_occupied_is_drawn_what_is_free_is_not_and_what_is_unknown_hardly(tmp_path: Path) -> None:
    plan = load_floor_plan(written(tmp_path))
    free, unknown, occupied = (int(opacity(plan.png)[hall() == kind][0]) for kind in (FREE, UNKNOWN, OCCUPIED))
    assert 0 == free < unknown < occupied
    assert (opacity(plan.png)[hall() == OCCUPIED] == occupied).all()


@pytest.mark.parametrize("name", ["map.pgm", "map.png", "map.bmp"])
def test_its_image_is_beside_it_in_any_of_the_formats(tmp_path: Path, name: str) -> None:
    assert load_floor_plan(written(tmp_path, image=name)).width == 3.0


def test_a_negated_image_is_dark_where_there_is_room(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    plan = load_floor_plan(written(tmp_path))
    negated = load_floor_plan(written(tmp_path / "other", 255 - hall(), negate="1"))
    assert (opacity(plan.png) == opacity(negated.png)).all()
    assert plan.digest == negated.digest


@pytest.mark.parametrize(
    ("pixel", "mode", "is_drawn_as"),
    [
        ((0, 255, 0), "trinary", OCCUPIED),
        ((205, 205, 205), "trinary", UNKNOWN),
        ((255, 255, 255, 0), "trinary", UNKNOWN),
        ((205, 205, 205, 255), "trinary", FREE),
        ((205, 205, 205, 255), "scale", UNKNOWN),
    ],
)
def test_colours_count_alike_and_so_does_opacity(
    tmp_path: Path, pixel: tuple[int, ...], mode: str, is_drawn_as: int
) -> None:
    drawn = load_floor_plan(written(tmp_path, np.full((2, 2, len(pixel)), pixel, np.uint8), image="map.png", mode=mode))
    grey = load_floor_plan(written(tmp_path, np.full((2, 2), is_drawn_as, np.uint8)))
    assert (opacity(drawn.png) == opacity(grey.png)).all()


def test_the_map_shows_the_part_that_is_known(tmp_path: Path) -> None:
    plan = load_floor_plan(written(tmp_path))
    assert (plan.width, plan.height, plan.x, plan.y, plan.yaw) == (3.0, 2.5, -3.0, 2.0, 0.0)
    assert set(plan.corners) == {(-2.5, 3.0), (-2.5, 4.0), (-0.5, 3.0), (-0.5, 4.0)}
    turned = load_floor_plan(written(tmp_path, origin=f"[0, 0, {pi / 2}]"))
    assert np.allclose(sorted(turned.corners), [(-2.0, 0.5), (-2.0, 2.5), (-1.0, 0.5), (-1.0, 2.5)])
    assert load_floor_plan(written(tmp_path, np.full((4, 4), UNKNOWN, np.uint8))).corners == ()


def test_thin_walls_of_a_large_map_stay_where_they_are(tmp_path: Path) -> None:
    cells = np.full((7, 2 * MOST_CELLS + 2), FREE, np.uint8)
    cells[0, 5] = OCCUPIED
    plan = load_floor_plan(written(tmp_path, cells))
    shown = opacity(plan.png)
    assert max(shown.shape) <= MOST_CELLS
    ((row, column),) = np.argwhere(shown)
    metres = plan.width / shown.shape[1]
    assert metres * column <= 5 * 0.5 < metres * (column + 1)
    assert metres * (len(shown) - row - 1) <= 6 * 0.5 < metres * (len(shown) - row)
    assert plan.height == pytest.approx(metres * len(shown))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"resolution": ""}, "map.yaml: resolution: Field required"),
        ({"resolution": "0"}, "map.yaml: resolution: Input should be greater than 0"),
        ({"resolution": "nan"}, "map.yaml: resolution: Input should be"),
        ({"resolution": "1e308"}, "map.yaml: resolution: Input should be less than or equal to 1000"),
        ({"resolution": "2026-13-01"}, "map.yaml: resolution: Input should be a valid number"),
        ({"resolution": "!!bool x"}, "map.yaml: resolution: Input should be a valid number"),
        ({"mode": "raw"}, "map.yaml: mode: Input should be 'trinary' or 'scale'"),
        ({"origin": "[0, 0, nan]"}, "map.yaml: origin.2: Input should be a finite number"),
        ({"origin": "[0, 0]"}, "map.yaml: origin.2: Field required"),
        ({"occupied_thresh": "0.1"}, "map.yaml: free_thresh is over occupied_thresh"),
        ({"negate": "[1"}, "map.yaml: line 5: expected"),
    ],
)
def test_a_mistake_in_the_yaml_file_is_named(tmp_path: Path, changes: dict[str, str], reason: str) -> None:
    file = written(tmp_path, **changes)
    with pytest.raises(FloorPlanError) as refused:
        load_floor_plan(file)
    assert str(refused.value).startswith(f"floor plan {tmp_path}/{reason}")
    assert "\n" not in str(refused.value)


def test_what_is_no_map_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refusal(file: Path) -> str:
        with pytest.raises(FloorPlanError) as refused:
            load_floor_plan(file)
        return str(refused.value).removeprefix(f"floor plan {tmp_path}/")

    assert refusal(tmp_path / "map.yaml") == "map.yaml: No such file or directory"
    file = written(tmp_path)
    (tmp_path / "map.pgm").unlink()
    assert refusal(file) == "map.pgm: No such file or directory"
    (tmp_path / "map.pgm").write_bytes(b"no image")
    assert refusal(file) == "map.pgm: not a map image; use PGM or PNG"
    (tmp_path / "map.pgm").write_bytes(b"P5\n6 5\n255\n" + bytes(29))
    assert refusal(file).startswith("map.pgm: ")
    (tmp_path / "list.yaml").write_text("- map.pgm\n", encoding="utf-8")
    assert refusal(tmp_path / "list.yaml") == "list.yaml: not a map's YAML file"
    (tmp_path / "list.yaml").write_bytes(b"\xff\xfe\x00")
    assert refusal(tmp_path / "list.yaml").startswith("list.yaml: ")
    assert "use 8 bits" in refusal(written(tmp_path, np.zeros((2, 2), np.uint16), image="deep.png"))
    monkeypatch.setattr(floor_plan, "MAX_PIXELS", 29)
    assert refusal(written(tmp_path)) == "map.pgm: 6 x 5 pixels: at most 29 are drawn"


def test_floor_is_the_darker_the_later_it_was_looked_at_and_clear_where_it_never_was() -> None:
    ages = np.array([[0, 60, 61], [600, 3_600, 3_601], [65_534, 65_535, 65_535]], "<u2")
    looks = FloorLooks(
        site="main", now_ns=1, origin=(-2.0, 5.0), cell_m=0.5, columns=3, rows=3, ages=memoryview(ages.tobytes())
    )
    drawn = looked_at(looks)
    assert drawn is not None
    assert (drawn.width, drawn.height, drawn.x, drawn.y, drawn.yaw) == (1.5, 1.5, -2.0, 5.0, 0.0)
    with Image.open(io.BytesIO(drawn.png)) as image:
        opacity = np.asarray(image.convert("RGBA"))[::-1, :, 3]  # rows from below, as the map has them
    steps = LOOKED_AT[1:]
    assert opacity.tolist() == [[steps[0], steps[0], steps[1]], [steps[1], steps[2], steps[3]], [steps[3], 0, 0]]
    assert sorted(steps, reverse=True) == list(steps)
