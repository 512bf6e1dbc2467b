import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from services.detector.runtime.openvino_engine import OpenVinoEngine

SIDE = 32

LEFT_ELSEWHERE = """
import signal, sys, threading
from pathlib import Path

from services.detector.runtime.openvino_engine import OpenVinoEngine

engines = [OpenVinoEngine(Path(sys.argv[1]), 1)]
elsewhere = threading.Thread(target=engines.clear)
elsewhere.start()
elsewhere.join()
signal.signal(signal.SIGTERM, lambda *_: print("heard"))
signal.raise_signal(signal.SIGTERM)
"""
"""Drops the last reference to a model on another thread than the one that made it, as the garbage collector may."""


@pytest.fixture
def brightness(tmp_path: Path) -> Path:
    """A file of a model whose only output is its input."""
    from openvino import Model, opset13, save_model  # noqa: PLC0415 - the engine sees to it that it does not phone

    images = opset13.parameter([1, 3, SIDE, SIDE], np.float32)
    same = Model([opset13.result(opset13.relu(images))], [images])
    save_model(same, tmp_path / "brightness.xml", compress_to_fp16=False)
    return tmp_path / "brightness.xml"


def test_bytes_reach_the_model_as_brightness_channel_by_channel(brightness: Path) -> None:
    images = np.zeros((1, SIDE, SIDE, 3), np.uint8)
    images[..., 1] = 255
    (found,) = OpenVinoEngine(brightness, 1).run(images)
    assert [plane.tolist() for plane in found.predictions[:, 0, :3]] == [[0, 0, 0], [1, 1, 1], [0, 0, 0]]


def test_signals_are_heard_after_a_model_was_dropped_on_another_thread(brightness: Path) -> None:
    program = [sys.executable, "-c", LEFT_ELSEWHERE, str(brightness)]
    ended = subprocess.run(program, capture_output=True, text=True, check=False, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "heard\n", "")
