"""The weights that are shipped, and how paths are kept out of them."""

import io
import zipfile
from pathlib import Path
from typing import Any

import pytest

from services.simulator.world import CLASSES
from services.toolbox.train.inference import open_weights
from services.training.checkpoints import embedded_paths
from services.training.evaluation.near_objects import near_figures
from services.training.evaluation.predictor import CONFIDENCE
from services.training.settings import WEIGHTS_FOLDER
from services.training.trainer import load_ultralytics

SHIPPED = WEIGHTS_FOLDER / "warehouse-n-seg.pt"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return load_ultralytics(tmp_path_factory.mktemp("ultralytics")).YOLO(str(SHIPPED))


def archive(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "paths"),
    [
        (b"X\x0a/home/me/data.yamlq", ["/home/me/data.yamlq"]),
        (b"\x8c\x04C:\\Users\\me", ["C:\\Users"]),
        (b"https://example.org/a/b ultralytics.nn.tasks a/b/c /data /", []),
    ],
)
def test_absolute_paths_are_found(content: bytes, paths: list[str]) -> None:
    assert embedded_paths(archive({"archive/data.pkl": content})) == paths


def test_tensors_are_not_searched() -> None:
    assert embedded_paths(archive({"archive/data/0": b"/home/me/x", "archive/version": b"3"})) == []


def test_the_shipped_model_is_what_the_detector_expects(model: Any) -> None:
    assert model.task == "segment"
    assert tuple(model.names.values()) == CLASSES
    assert model.overrides["imgsz"] == 640


def test_the_shipped_file_is_small_and_says_nothing_about_its_maker() -> None:
    content = SHIPPED.read_bytes()
    assert len(content) < 8_000_000
    assert embedded_paths(content) == []
    assert str(Path.home()) not in SHIPPED.with_suffix(".md").read_text()


def test_the_shipped_model_names_near_objects_on_unseen_drives(tmp_path: Path) -> None:
    look = open_weights(SHIPPED, confidence=CONFIDENCE, device="cpu", folder=tmp_path)
    near = near_figures(look, (700, 702, 706, 707), 6, lambda _done: None)
    assert sum(near.objects.values()) > 30
    assert near.share > 0.8
