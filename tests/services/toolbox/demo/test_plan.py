"""What the demo starts its detector with."""

from pathlib import Path

import pytest

from services.detector import settings as detector
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL
from services.toolbox.demo.process import plan
from services.toolbox.demo.settings import DemoSettings


@pytest.mark.parametrize(
    ("gpu", "model", "file", "runtime"),
    [
        (False, None, SHIPPED_EXPORT, "onnx"),
        (True, None, SHIPPED_MODEL, "torch"),
        (False, SHIPPED_MODEL, SHIPPED_MODEL, "torch"),
        (True, SHIPPED_EXPORT, SHIPPED_EXPORT, "onnx"),
    ],
)
def test_nothing_is_exported_before_the_first_image(
    *, gpu: bool, model: Path | None, file: Path, runtime: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(detector, "GPU", tmp_path if gpu else tmp_path / "no driver")
    settings = DemoSettings(model=None if model is None else str(model))
    command = plan(settings, "tcp/127.0.0.1:7447", 11311)["detector"]
    assert command == [
        *("detector", "--connect", "tcp/127.0.0.1:7447"),
        *("--runtime", runtime, "--model", str(file)),
    ]
