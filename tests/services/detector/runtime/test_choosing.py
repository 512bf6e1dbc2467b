import logging
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.model import ModelError
from services.detector.runtime.choosing import KEPT_S, RuntimeTarget, choose, for_weights
from services.detector.runtime.engine import Engine, Runtime
from services.detector.runtime.postprocess import Output

BLANK = np.zeros((1, 32, 32, 3), np.uint8)
QUICK: Runtime = "onnx"


class Slow:
    """Takes its time."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        time.sleep(self._seconds)
        return [Output(np.zeros((6, 0), np.float32), None) for _ in images]


def place(cache: Path, digest: str = "d1", gpu: str = "") -> RuntimeTarget:
    cache.mkdir(exist_ok=True)
    return RuntimeTarget(digest, 320, "cpu", 2, cache, spare=cache / "spare", gpu=gpu, candidates=for_weights("cpu"))


def maker(asked: list[Runtime], *broken: Runtime) -> Callable[[Runtime], Engine]:
    def make(runtime: Runtime) -> Engine:
        asked.append(runtime)
        if runtime in broken:
            raise RuntimeError("it does not run here")
        return Slow(0.0 if runtime == QUICK else 0.02)

    return make


def test_the_fastest_is_chosen_and_remembered_for_these_weights_on_this_gpu(tmp_path: Path) -> None:
    first: list[Runtime] = []
    assert choose(maker(first), place(tmp_path), BLANK)[0] == QUICK
    assert set(first) == {"openvino", "onnx", "torch"}
    again: list[Runtime] = []
    assert choose(maker(again), place(tmp_path), BLANK)[0] == QUICK
    assert again == [QUICK]
    for elsewhere in (place(tmp_path, "d2"), place(tmp_path, gpu="NVIDIA L4")):
        other: list[Runtime] = []
        choose(maker(other), elsewhere, BLANK)
        assert set(other) == set(first)


@pytest.mark.parametrize(("age_s", "measured"), [(KEPT_S - 60, 1), (KEPT_S + 1, 3), (-60, 3)])
def test_what_was_remembered_is_measured_again_after_a_week_or_a_clock_set_back(
    tmp_path: Path, age_s: float, measured: int
) -> None:
    choose(maker([]), place(tmp_path), BLANK)
    (memory,) = tmp_path.glob("choice-*")
    then = time.time() - age_s
    os.utime(memory, (then, then))
    asked: list[Runtime] = []
    choose(maker(asked), place(tmp_path), BLANK)
    assert len(asked) == measured
    assert abs(time.time() - memory.stat().st_mtime) < (60 if measured == 3 else age_s + 60)


def test_what_does_not_run_is_said_and_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        chosen, _ = choose(maker([], "onnx", "openvino"), place(tmp_path), BLANK)
    assert chosen == "torch"
    assert [record.getMessage() for record in caplog.records] == [
        "not with --runtime openvino: it does not run here",
        "not with --runtime onnx: it does not run here",
    ]


def test_what_was_remembered_and_no_longer_runs_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    choose(maker([]), place(tmp_path), BLANK)
    asked: list[Runtime] = []
    with caplog.at_level(logging.WARNING):
        chosen, _ = choose(maker(asked, QUICK), place(tmp_path), BLANK)
    assert chosen in {"openvino", "torch"}
    assert asked == [QUICK, "openvino", "torch"]
    assert [record.getMessage() for record in caplog.records] == ["not with --runtime onnx: it does not run here"]
    assert choose(maker([]), place(tmp_path), BLANK)[0] == chosen


def test_none_that_works_is_an_error_that_says_so(tmp_path: Path) -> None:
    choose(maker([]), place(tmp_path), BLANK)
    with pytest.raises(ModelError, match="no runtime works here"):
        choose(maker([], "onnx", "openvino", "torch"), place(tmp_path), BLANK)


def test_a_choice_that_cannot_be_kept_is_made_all_the_same(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    no_folder = tmp_path / "cache"
    no_folder.touch()
    with caplog.at_level(logging.WARNING):
        assert choose(maker([]), replace(place(tmp_path), cache=no_folder), BLANK)[0] == QUICK
    assert "onnx is measured again at the next start" in caplog.text
    assert str(no_folder) in caplog.text


def test_a_damaged_memory_is_no_memory(tmp_path: Path) -> None:
    choose(maker([]), place(tmp_path), BLANK)
    for memory in tmp_path.glob("choice-*"):
        memory.write_bytes(b"\xff\xfe")
    asked: list[Runtime] = []
    choose(maker(asked), place(tmp_path), BLANK)
    assert len(asked) == 3
