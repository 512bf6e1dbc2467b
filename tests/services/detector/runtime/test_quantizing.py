"""INT8 networks are made of pictures and find what single precision finds; what they cannot be made of is refused."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from services.detector import runtime
from services.detector.model import ModelError
from services.detector.runtime import quantizing
from services.detector.runtime.exported_model import read_exported
from services.detector.runtime.loading import load
from services.detector.runtime.quantizing import CALIBRATING, LEAST_COMPARING, Quantizer
from services.detector.runtime.refinement.refiner import CloseUps, Refined
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL, DetectorSettings
from tests.services.detector.support.views import NEAR_VIEWS, near_view

ENOUGH = CALIBRATING + LEAST_COMPARING


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Pictures in which classes are clearly there or not, on any processor, in folders of their own."""
    folder = tmp_path_factory.mktemp("pictures")
    views = [near_view(each) for each in NEAR_VIEWS]
    files = [folder / f"robot-{n % 3}" / f"{n:03}.png" for n in range(ENOUGH)]
    for n, file in enumerate(files):
        file.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(file), views[n % len(views)])
    return sorted(files)


def quantizer(pictures: list[Path]) -> Quantizer:
    return Quantizer(read_exported(str(SHIPPED_EXPORT)), 320, pictures, lambda *_: None)


def test_an_export_has_int8_networks_that_find_the_same_classes(pictures: list[Path], tmp_path: Path) -> None:
    made, folder = tmp_path / "made.onnx", pictures[0].parent.parent
    command = [sys.executable, "-m", "fleetsight", "model", "export", str(SHIPPED_MODEL), "--image-size", "320"]
    environment = {**os.environ, "HOME": str(tmp_path / "home"), "XDG_CONFIG_HOME": str(tmp_path / "home")}
    done = subprocess.run(
        [*command, "--int8", str(folder), "--output", str(made)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert f"in INT8 {LEAST_COMPARING} of {LEAST_COMPARING} pictures get the same classes\n" in done.stdout
    assert not (tmp_path / "home").exists()  # Ultralytics would keep its settings there
    model = read_exported(str(made))
    assert model.int8 is not None
    assert model.refiner is not None
    assert model.int8.refiner is not None
    for network in (model.int8.network, model.int8.refiner):
        graph = onnx.load_from_string(network).graph
        convolutions = [each for each in graph.node if each.op_type == "Conv"]
        rounded = {each.output[0] for each in graph.node if each.op_type == "DequantizeLinear"}
        assert sum(each.input[0] in rounded and each.input[1] in rounded for each in convolutions) > 10
    assert load(DetectorSettings(model=str(made), runtime="openvino-int8"), tmp_path).runtime == "openvino-int8"


def test_too_few_pictures_are_refused(pictures: list[Path]) -> None:
    with pytest.raises(ModelError, match=f"{ENOUGH - 1} pictures in the folder; {ENOUGH} are needed at least"):
        quantizer(pictures[1:])


def test_pictures_of_all_over_the_folder_calibrate_and_others_are_compared(pictures: list[Path]) -> None:
    made = quantizer(pictures)
    assert len(made._calibrating) == CALIBRATING
    assert {each.parent for each in made._calibrating} == {each.parent for each in pictures}
    assert sorted([*made._calibrating, *made._comparing]) == pictures


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quantizing, "CALIBRATING", 2)
    monkeypatch.setattr(quantizing, "LEAST_COMPARING", 2)


@pytest.mark.usefixtures("few")
def test_a_picture_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    files = [tmp_path / f"{n}.png" for n in range(4)]
    files[0].write_bytes(b"no picture")
    with pytest.raises(ModelError, match=r"--int8: \S*/0\.png: not an image in a supported format"):
        quantizer(files)(SHIPPED_EXPORT.read_bytes(), None)


@pytest.mark.usefixtures("few")
def test_networks_that_find_too_much_else_are_refused(pictures: list[Path]) -> None:
    """These have been calibrated on black pictures: all that is in others is far beyond their numbers."""
    black = pictures[0].parent.parent / "black.png"
    cv2.imwrite(str(black), np.zeros((240, 320, 3), np.uint8))
    made = quantizer(pictures[:4])
    made._calibrating = [black]
    with pytest.raises(ModelError, match=r"--int8: of 2 pictures|--int8: boxes of the same"):
        made(SHIPPED_EXPORT.read_bytes(), None)


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("refined", [False, True])
def test_pictures_without_objects_are_refused(tmp_path: Path, *, refined: bool) -> None:
    files = [tmp_path / f"{n}.png" for n in range(4)]
    for file in files:
        cv2.imwrite(str(file), np.zeros((480, 640, 3), np.uint8))
    model = read_exported(str(SHIPPED_EXPORT))
    assert model.refiner is not None
    with pytest.raises(ModelError, match=r"--int8: the model finds (no objects in the|objects in 0 of 2) pictures"):
        quantizer(files)(SHIPPED_EXPORT.read_bytes(), model.refiner if refined else None)


@pytest.mark.usefixtures("few")
def test_a_library_that_does_not_work_is_said_before_anything_is_calibrated(
    pictures: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "services.detector.runtime.openvino_engine", None)
    monkeypatch.delattr(runtime, "openvino_engine", raising=False)
    told: list[str] = []
    made = Quantizer(read_exported(str(SHIPPED_EXPORT)), 320, pictures[:4], lambda step, *_: told.append(step))
    with pytest.raises(ModelError, match="--int8: the networks cannot be made or compared: import of services"):
        made(SHIPPED_EXPORT.read_bytes(), None)
    assert told == []


class BrokenRefiner:
    """Is none."""

    def run(self, _: CloseUps) -> Refined:
        """See `Refiner.run`."""
        raise RuntimeError("no such operator")


@pytest.mark.usefixtures("few")
def test_a_refiner_that_fails_in_int8_is_no_refiner(pictures: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    model = read_exported(str(SHIPPED_EXPORT))
    assert model.int8 is not None
    network, runtimes = model.int8.network, quantizing._runtime()
    broken = replace(runtimes, refiner=lambda _: BrokenRefiner())
    monkeypatch.setattr(quantizing, "_runtime", lambda: broken)
    monkeypatch.setattr(quantizing, "_int8", lambda *_: network)
    with pytest.raises(
        ModelError, match=r"--int8: \S+ leaves masks coarse where refining them fails: no such operator"
    ):
        quantizer(pictures[:4])(SHIPPED_EXPORT.read_bytes(), model.refiner)
