import logging
import os
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.model import ModelError
from services.detector.runtime.choosing import (
    KEPT_BUSY_S,
    KEPT_S,
    LEAST_ROUNDS,
    MOST_ROUNDS,
    REPEATS,
    RuntimeTarget,
    batch_size,
    choose,
    for_weights,
    measure,
)
from services.detector.runtime.engine import Engine, OutOfMemoryError, Runtime
from services.detector.runtime.postprocess import Output

BLANK = np.zeros((1, 32, 32, 3), np.uint8)
QUICK: Runtime = "onnx"


class Machine:
    """A clock that engines move on: each call takes the next of its engine's times, over and over."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def clock(self) -> float:
        return self.now_s


class Slow:
    """Takes its time on a machine."""

    def __init__(self, machine: Machine, *seconds: float) -> None:
        self._machine = machine
        self._seconds = cycle(seconds)
        self.calls = 0

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        self.calls += 1
        self._machine.now_s += next(self._seconds)
        return [Output(np.zeros((6, 0), np.float32), None) for _ in images]


MACHINE = Machine()


def place(cache: Path, digest: str = "d1", gpu: str = "") -> RuntimeTarget:
    cache.mkdir(exist_ok=True)
    return RuntimeTarget(digest, 320, "cpu", 2, cache, spare=cache / "spare", gpu=gpu, candidates=for_weights("cpu"))


def maker(asked: list[Runtime], *broken: Runtime) -> Callable[[Runtime], Engine]:
    def make(runtime: Runtime) -> Engine:
        asked.append(runtime)
        if runtime in broken:
            raise RuntimeError("it does not run here")
        return Slow(MACHINE, 0.01 if runtime == QUICK else 0.02)

    return make


def test_the_fastest_is_chosen_and_remembered_for_these_weights_on_this_gpu(tmp_path: Path) -> None:
    first: list[Runtime] = []
    assert choose(maker(first), place(tmp_path), BLANK, MACHINE.clock)[0] == QUICK
    assert set(first) == {"openvino", "onnx", "torch"}
    again: list[Runtime] = []
    assert choose(maker(again), place(tmp_path), BLANK, MACHINE.clock)[0] == QUICK
    assert again == [QUICK]
    for elsewhere in (place(tmp_path, "d2"), place(tmp_path, gpu="NVIDIA L4")):
        other: list[Runtime] = []
        choose(maker(other), elsewhere, BLANK, MACHINE.clock)
        assert set(other) == set(first)


@pytest.mark.parametrize(("age_s", "measured"), [(KEPT_S - 60, 1), (KEPT_S + 1, 3), (-60, 3)])
def test_what_was_remembered_is_measured_again_after_a_week_or_a_clock_set_back(
    tmp_path: Path, age_s: float, measured: int
) -> None:
    choose(maker([]), place(tmp_path), BLANK, MACHINE.clock)
    (memory,) = tmp_path.glob("choice-*")
    then = time.time() - age_s
    os.utime(memory, (then, then))
    asked: list[Runtime] = []
    choose(maker(asked), place(tmp_path), BLANK, MACHINE.clock)
    assert len(asked) == measured
    assert abs(time.time() - memory.stat().st_mtime) < (60 if measured == 3 else age_s + 60)


def test_what_does_not_run_is_said_and_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        chosen, _ = choose(maker([], "onnx", "openvino"), place(tmp_path), BLANK, MACHINE.clock)
    assert chosen == "torch"
    assert [record.getMessage() for record in caplog.records] == [
        "--runtime openvino does not work here: it does not run here",
        "--runtime onnx does not work here: it does not run here",
    ]


def test_what_was_remembered_and_no_longer_runs_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    choose(maker([]), place(tmp_path), BLANK, MACHINE.clock)
    asked: list[Runtime] = []
    with caplog.at_level(logging.WARNING):
        chosen, _ = choose(maker(asked, QUICK), place(tmp_path), BLANK, MACHINE.clock)
    assert chosen in {"openvino", "torch"}
    assert asked == [QUICK, "openvino", "torch"]
    assert [record.getMessage() for record in caplog.records] == [
        "--runtime onnx does not work here: it does not run here"
    ]
    assert choose(maker([]), place(tmp_path), BLANK, MACHINE.clock)[0] == chosen


def test_none_that_works_is_an_error_that_says_so(tmp_path: Path) -> None:
    choose(maker([]), place(tmp_path), BLANK, MACHINE.clock)
    with pytest.raises(ModelError, match="no runtime works here"):
        choose(maker([], "onnx", "openvino", "torch"), place(tmp_path), BLANK, MACHINE.clock)


def test_a_choice_that_cannot_be_kept_is_made_all_the_same(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    no_folder = tmp_path / "cache"
    no_folder.touch()
    with caplog.at_level(logging.WARNING):
        assert choose(maker([]), replace(place(tmp_path), cache=no_folder), BLANK, MACHINE.clock)[0] == QUICK
    assert "onnx is measured again at the next start" in caplog.text
    assert str(no_folder) in caplog.text


def test_a_damaged_memory_is_no_memory(tmp_path: Path) -> None:
    choose(maker([]), place(tmp_path), BLANK, MACHINE.clock)
    for memory in tmp_path.glob("choice-*"):
        memory.write_bytes(b"\xff\xfe")
    asked: list[Runtime] = []
    choose(maker(asked), place(tmp_path), BLANK, MACHINE.clock)
    assert len(asked) == 3


def engines(machine: Machine, **seconds: tuple[float, ...]) -> dict[Runtime, Slow]:
    return {runtime: Slow(machine, *seconds[runtime]) for runtime in for_weights("cpu") if runtime in seconds}


def chosen(folder: Path, made: dict[Runtime, Slow], machine: Machine) -> Runtime:
    where = replace(place(folder), candidates=tuple(made))
    return choose(made.__getitem__, where, BLANK, machine.clock)[0]


def test_runtimes_that_are_clearly_apart_are_measured_no_longer_than_needed() -> None:
    machine = Machine()
    made = engines(machine, openvino=(0.08,), onnx=(0.1,), torch=(0.3,))
    timings = measure(made, BLANK, machine.clock)
    assert [round(timings[each].usual, 3) for each in timings] == [0.08, 0.1, 0.3]
    assert made["openvino"].calls == made["onnx"].calls == LEAST_ROUNDS * (1 + REPEATS)
    assert made["torch"].calls == 1 + REPEATS  # hopeless after one round


def test_runtimes_that_vary_are_measured_until_they_are_apart_or_often_enough() -> None:
    machine = Machine()
    made = engines(machine, openvino=(0.08, 0.08, 0.08, 0.08, 0.11), onnx=(0.09, 0.15, 0.09, 0.15))
    measure(made, BLANK, machine.clock)
    assert made["onnx"].calls == LEAST_ROUNDS * (1 + REPEATS)
    noisy = engines(machine, openvino=(0.08, 0.12, 0.13, 0.12), onnx=(0.09, 0.13, 0.12, 0.12))
    measure(noisy, BLANK, machine.clock)
    assert noisy["openvino"].calls == noisy["onnx"].calls == MOST_ROUNDS * (1 + REPEATS)


def test_of_runtimes_that_are_as_fast_every_start_takes_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for number, (one, other) in enumerate([(0.08, 0.081), (0.081, 0.08)]):
        machine = Machine()
        with caplog.at_level(logging.INFO):
            assert (
                chosen(tmp_path / str(number), engines(machine, openvino=(one,), onnx=(other,)), machine) == "openvino"
            )
        assert "openvino is the fastest here, another is as fast: openvino 8" in caplog.text


def test_it_is_said_by_how_much_a_runtime_is_faster(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    machine = Machine()
    with caplog.at_level(logging.INFO):
        assert chosen(tmp_path, engines(machine, openvino=(0.1,), onnx=(0.08,), torch=(0.2,)), machine) == "onnx"
    assert [record.getMessage() for record in caplog.records] == [
        "onnx is the fastest here, the next takes 25% longer: openvino 100 ms, onnx 80 ms, torch 200 ms"
    ]


def test_it_is_said_why_int8_that_is_faster_is_not_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    machine = Machine()
    made: dict[Runtime, Slow] = {"openvino": Slow(machine, 0.1), "openvino-int8": Slow(machine, 0.094)}
    with caplog.at_level(logging.INFO):
        assert chosen(tmp_path, made, machine) == "openvino"
    (said,) = (record.getMessage() for record in caplog.records)
    times = "openvino 100 ms, openvino-int8 94 ms"
    assert said.startswith("openvino is the fastest here, but for openvino-int8, which saves 6%: less than the 10%")
    assert said.endswith(f"is taken: {times}")


@pytest.mark.parametrize(("age_s", "measured"), [(KEPT_BUSY_S - 60, 1), (KEPT_BUSY_S + 60, 2)])
def test_what_was_measured_on_a_busy_machine_is_not_kept_for_a_week(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, age_s: float, measured: int
) -> None:
    machine = Machine()
    with caplog.at_level(logging.INFO):
        made = engines(machine, openvino=(0.08, 0.12, 0.13, 0.12), onnx=(0.3,))
        assert chosen(tmp_path, made, machine) == "openvino"
    assert "the machine was busy" in caplog.text
    (memory,) = tmp_path.glob("choice-*")
    then = time.time() - age_s
    os.utime(memory, (then, then))
    again = engines(machine, openvino=(0.08,), onnx=(0.3,))
    assert chosen(tmp_path, again, machine) == "openvino"
    assert sum(each.calls > 0 for each in again.values()) == (measured if measured > 1 else 0)


class Batches:
    """Takes some time for each call, and for each image in it; of more than `most` it has no memory."""

    def __init__(self, machine: Machine, call_s: float, image_s: float, most: int) -> None:
        self._machine = machine
        self._call_s, self._image_s, self._most = call_s, image_s, most

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        if len(images) > self._most:
            raise OutOfMemoryError
        if len(images) > 4 and self._call_s > 0.07:
            raise RuntimeError("its shape is fixed")
        self._machine.now_s += self._call_s + len(images) * self._image_s
        return [Output(np.zeros((6, 0), np.float32), None) for _ in images]


@pytest.mark.parametrize(
    ("takes", "size", "told"),
    [
        ((0.004, 0.001, 99), 8, "batches of 8: 1.5 ms an image, 5.0 ms one by one"),
        ((0.002, 0.005, 99), 2, "batches of 2: 6.0 ms an image, 7.0 ms one by one"),
        ((0.001, 0.020, 99), 1, "batches of 1: 21.0 ms an image, 21.0 ms one by one"),
        ((0.004, 0.001, 5), 4, "batches of 4: 2.0 ms an image, 5.0 ms one by one"),
        ((0.030, 0.010, 99), 4, "batches of 4: 17.5 ms an image, 40.0 ms one by one"),
        ((0.080, 0.004, 99), 4, "batches of 4: 24.0 ms an image, 84.0 ms one by one"),
    ],
)
def test_batches_are_as_large_as_pays_fits_into_memory_and_leaves_frames_new(
    takes: tuple[float, float, int], size: int, told: str, caplog: pytest.LogCaptureFixture
) -> None:
    machine = Machine()
    with caplog.at_level(logging.INFO):
        assert batch_size(Batches(machine, *takes), BLANK, None, machine.clock) == size
    assert caplog.messages[-1:] == [told]
    assert [each for each in caplog.messages if "do not work" in each] == (
        ["batches of 8 do not work here: its shape is fixed"] if takes[0] > 0.07 else []
    )


@pytest.mark.parametrize(("int8_s", "chosen"), [(0.0095, "openvino"), (0.0088, "openvino-int8"), (0.02, "openvino")])
def test_int8_is_taken_where_it_saves_a_tenth_of_the_time(int8_s: float, chosen: Runtime, tmp_path: Path) -> None:
    times: dict[Runtime, float] = {"openvino": 0.01, "openvino-int8": int8_s, "onnx": 0.0101}
    here = replace(place(tmp_path), candidates=tuple(times))
    assert choose(lambda runtime: Slow(MACHINE, times[runtime]), here, BLANK, MACHINE.clock)[0] == chosen


def test_a_choice_is_not_that_of_other_candidates(tmp_path: Path) -> None:
    times: dict[Runtime, float] = {"openvino": 0.01, "openvino-int8": 0.005}
    both: tuple[tuple[Runtime, ...], ...] = (("openvino-int8", "openvino"), ("openvino", "onnx"))
    for candidates in both:
        here, chosen = replace(place(tmp_path), candidates=candidates), candidates[0]
        assert choose(lambda each: Slow(MACHINE, times.get(each, 0.02)), here, BLANK, MACHINE.clock)[0] == chosen
    assert len(list(tmp_path.glob("choice-*"))) == 2
