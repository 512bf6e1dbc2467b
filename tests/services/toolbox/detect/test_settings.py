"""The model and the runtime that `fleetsight detect --local` takes."""

from pathlib import Path

import pytest

from services.detector import settings as detector
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL
from services.toolbox.detect.settings import DetectSettings

PT, ONNX = str(SHIPPED_MODEL), str(SHIPPED_EXPORT)


@pytest.mark.parametrize(
    ("gpu", "given", "model", "runtime"),
    [
        (False, {}, ONNX, "auto"),
        (False, {"model": "warehouse-n-seg"}, ONNX, "auto"),
        (False, {"model": "warehouse-n-seg.pt"}, PT, "torch"),
        (False, {"model": PT, "runtime": "onnx"}, PT, "onnx"),
        (False, {"detection_model": PT}, PT, "torch"),
        (False, {"model": ONNX, "detection_model": PT}, ONNX, "auto"),
        (False, {"runtime": "torch"}, PT, "torch"),
        (True, {}, PT, "torch"),
        (True, {"device": "cpu"}, ONNX, "auto"),
    ],
)
def test_weights_run_under_torch_and_exported_models_under_what_can(
    *, gpu: bool, given: dict[str, str], model: str, runtime: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(detector, "GPU", tmp_path if gpu else tmp_path / "no driver")
    (tmp_path / "photo.jpg").touch()
    settings = DetectSettings.model_validate({"image": tmp_path / "photo.jpg", "local": True, **given})
    assert (settings.of_model.model, settings.of_model.runtime) == (model, runtime)
