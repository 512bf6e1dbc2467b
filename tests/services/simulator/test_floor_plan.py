"""What the simulator writes is a map as map_server has it, of the warehouse that its robots drive through."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from services.simulator.errors import FloorPlanError
from services.simulator.floor_plan import FREE, OCCUPIED, write_floor_plan
from services.simulator.world import Drive, generate


def test_robots_drive_where_it_is_free_and_objects_stand_where_it_is_not(tmp_path: Path) -> None:
    write_floor_plan(tmp_path / "map.yaml", 3)
    said = yaml.safe_load((tmp_path / "map.yaml").read_text())
    pixels = np.asarray(Image.open(tmp_path / said["image"]))
    assert set(np.unique(pixels)) == {FREE, OCCUPIED}

    def shade(x: float, y: float) -> int:
        left, bottom, _ = said["origin"]
        column, row = int((x - left) / said["resolution"]), int((y - bottom) / said["resolution"])
        return int(pixels[len(pixels) - 1 - row, column])

    scene = generate(3)
    drive = Drive.plan(scene)
    assert all(shade(*drive.pose(part).position[:2]) == FREE for part in np.linspace(0, 1, 20, endpoint=False))
    parts = scene.cuboids.corners()[scene.cuboids.instances > 0]
    low = parts[(parts[..., 2].min(axis=1) < 1) & (parts[..., 2].max(axis=1) > 0.1)]
    assert len(low) > 100
    assert all(shade(*at[:2]) == OCCUPIED for at in low.mean(axis=1))
    assert pixels[0].max() == pixels[:, 0].max() == OCCUPIED, "walls"


def test_a_name_that_means_something_in_yaml_is_quoted(tmp_path: Path) -> None:
    write_floor_plan(tmp_path / "hall 1: #2.yaml", 1)
    said = yaml.safe_load((tmp_path / "hall 1: #2.yaml").read_text())
    assert (tmp_path / said["image"]).is_file()


@pytest.mark.parametrize("name", ["map.yaml", "map.pgm"])
def test_a_map_that_is_there_already_stays(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("a real one")
    with pytest.raises(FloorPlanError, match=rf"--floor-plan .*map.yaml: .*/{name} already exists"):
        write_floor_plan(tmp_path / "map.yaml", 1)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["a real one"]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FloorPlanError, match=r"--floor-plan .*absent/map.yaml: No such file or directory"):
        write_floor_plan(tmp_path / "absent" / "map.yaml", 1)
