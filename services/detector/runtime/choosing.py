"""Chooses a model's runtime, the requested one or the fastest of those installed, and its batch size, by measuring."""

import hashlib
import logging
import math
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.model import ModelError, first_line
from services.detector.runtime.engine import BATCH_ON_GPU, Engine, OutOfMemoryError, Runtime
from services.detector.runtime.exporting import MAKING, installed
from services.detector.settings import DEADLINE_SLACK_S, LEAST_AGE_S

log = logging.getLogger(__name__)

NEEDS: Final[Mapping[Runtime, tuple[str, ...]]] = {
    "torch": (),
    "onnx": ("onnx", "onnxruntime"),
    "openvino": ("onnx", "openvino"),
    "openvino-int8": ("onnx", "openvino"),
    "tensorrt": ("onnx", "tensorrt"),
}
"""Packages that make a model of weights run, beside torch."""

REMEDIES: Final[Mapping[Runtime, str]] = {
    "onnx": "see fleetsight's extra [onnx]",
    "openvino": "see fleetsight's extra [openvino]",
    "tensorrt": "see fleetsight's extra [onnx], and NVIDIA's package tensorrt for this machine's CUDA",
}
FOR_DEVICE: Final[Mapping[str, tuple[Runtime, ...]]] = {
    "cpu": ("openvino", "onnx", "torch"),
    "cuda": ("tensorrt", "torch"),
}
LEAST_ROUNDS: Final = 3
MOST_ROUNDS: Final = 12
REPEATS: Final = 2
EQUAL: Final = 0.03
"""The share by which the times of two runtimes may differ for both to be as fast; the first candidate is then taken."""
INT8: Final = "openvino-int8"
LEAST_GAIN: Final = 0.1
"""The share of the time that INT8 must save to be taken: its objects differ a little."""
HOPELESS: Final = 1.5
"""How much longer than the fastest a runtime may take to be measured on."""
BUSY: Final = 1.25
"""How much longer than its shortest time a runtime usually takes where something else keeps the machine busy."""
KEPT_S: Final = 7 * 24 * 3600
"""How long a choice is kept: machines change."""
KEPT_BUSY_S: Final = 3600
"""How long one is kept that was made on a busy machine."""
BUSY_MARK: Final = "on a busy machine"

LEAST_SAVED: Final = 0.1
"""The share of an image's time that a batch of twice the size must save."""

Clock = Callable[[], float]


@dataclass(frozen=True, slots=True)
class RuntimeTarget:
    """Where a model runs. digest: of its weights; longest: longer side of its input in pixels.

    spare: where what is made goes if the cache cannot be written. gpu: what kind the device is, empty if it is none.
    candidates: the runtimes that are installed.
    """

    digest: str
    longest: int
    device: str
    threads: int
    cache: Path
    spare: Path
    gpu: str = ""
    candidates: tuple[Runtime, ...] = ()


def check_installed(runtime: Runtime) -> None:
    """Raise ModelError unless the packages that a runtime needs are installed."""
    if missing := _missing(runtime):
        raise ModelError(f"--runtime {runtime}: {missing[0]} is not installed; {REMEDIES[runtime]}")


@dataclass(frozen=True, slots=True)
class Timing:
    """The shortest time, in seconds, that a runtime took for a batch, and the median of its times."""

    shortest: float
    usual: float

    @classmethod
    def of(cls, times: Sequence[float]) -> "Timing":
        return cls(min(times), median(times))

    def is_apart(self, other: "Timing") -> bool:
        """Return whether another one is slower for certain: it never took as little time as this one usually takes."""
        return other.shortest > self.usual * (1 + EQUAL)

    def equals(self, other: "Timing") -> bool:
        pairs = (self.shortest, other.shortest), (self.usual, other.usual)
        return all(max(pair) <= min(pair) * (1 + EQUAL) for pair in pairs)


def choose(
    make: Callable[[Runtime], Engine],
    place: RuntimeTarget,
    blank: NDArray[np.uint8],
    clock: Clock = time.perf_counter,
) -> tuple[Runtime, Engine]:
    """Return the fastest runtime for a device and the model under it.

    Choices are kept for a week, or for an hour if the machine was busy. A kept choice that no longer works is left
    out, with a warning.

    make: returns the model under a runtime that has proved that it works. blank: a batch to measure with.

    Raises:
        ModelError: none of them works.
    """
    candidates = place.candidates
    memory = _memory(place, candidates)
    known = _recall(memory)
    engines = dict(_made(make, [known])) if known in candidates else {}
    if not engines:
        engines = dict(_made(make, [each for each in candidates if each != known]))
    if len(engines) == 1:
        return next(iter(engines.items()))
    if not engines:
        raise ModelError("no runtime works here; the warnings say why")
    timings = measure(engines, blank, clock)
    best = _fastest(timings)
    busy = timings[best].usual > BUSY * timings[best].shortest
    log.info("%s", _told(best, timings, busy=busy))
    _remember(memory, best, busy=busy)
    return best, engines[best]


def measure(
    engines: Mapping[Runtime, Engine], blank: NDArray[np.uint8], clock: Clock = time.perf_counter
) -> dict[Runtime, Timing]:
    """Return how long each runtime takes for a batch: in turn, until the fastest and each other are apart or equal.

    The first of each turn does not count: another library's threads may still be spinning.
    """
    times: dict[Runtime, list[float]] = {name: [] for name in engines}
    timings: dict[Runtime, Timing] = {}
    for done in range(1, MOST_ROUNDS + 1):
        least = min((each.shortest for each in timings.values()), default=math.inf)
        for name, engine in engines.items():
            if name in timings and timings[name].shortest > HOPELESS * least:
                continue
            engine.run(blank)
            for _ in range(REPEATS):
                began = clock()
                engine.run(blank)
                times[name].append(clock() - began)
        timings = {name: Timing.of(each) for name, each in times.items()}
        best = timings[min(timings, key=lambda name: timings[name].shortest)]
        if done >= LEAST_ROUNDS and all(best.is_apart(each) or best.equals(each) for each in timings.values()):
            break
    return timings


def batch_size(
    engine: Engine, blank: NDArray[np.uint8], max_age_s: float | None, clock: Clock = time.perf_counter
) -> int:
    """Return how many images one call is to compute: twice as many as long as that saves a tenth of an image's time.

    blank: an empty image, 1 x height x width x RGB. max_age_s: as in the settings; no call takes longer than frames may
    wait. Sizes are powers of two up to BATCH_ON_GPU.
    """
    best, alone = 1, _shortest(engine, blank, clock)
    each, most_s = alone, max_age_s or max(LEAST_AGE_S, alone + DEADLINE_SLACK_S)
    while (size := 2 * best) <= BATCH_ON_GPU:
        try:
            took = _shortest(engine, np.repeat(blank, size, axis=0), clock)
        except OutOfMemoryError:
            break
        except Exception as error:  # noqa: BLE001 - one by one it works
            log.warning("batches of %d do not work here: %s", size, first_line(error))
            break
        if took > most_s or took / size > each * (1 - LEAST_SAVED):
            break
        best, each = size, took / size
    log.info("batches of %d: %.1f ms an image, %.1f ms one by one", best, each * 1e3, alone * 1e3)
    return best


def _shortest(engine: Engine, batch: NDArray[np.uint8], clock: Clock) -> float:
    """Return the seconds that a call takes at least; the first one does not count."""
    engine.run(batch)
    times: list[float] = []
    for _ in range(LEAST_ROUNDS):
        began = clock()
        engine.run(batch)
        times.append(clock() - began)
    return min(times)


def _fastest(timings: Mapping[Runtime, Timing]) -> Runtime:
    """Return the fastest runtime; of some that are as fast the first, so that every start chooses the same one."""
    shortest = {name: each.shortest for name, each in timings.items()}
    int8, least = shortest.pop(INT8, math.inf), min(shortest.values(), default=math.inf)
    if int8 <= least * (1 - LEAST_GAIN):
        return INT8
    return next(name for name, each in shortest.items() if each <= least * (1 + EQUAL))


def _told(best: Runtime, timings: Mapping[Runtime, Timing], *, busy: bool) -> str:
    others = [each.shortest for name, each in timings.items() if name != best]
    longer = min(others) / timings[best].shortest - 1
    saved = 1 - timings[INT8].shortest / timings[best].shortest if INT8 in timings else 0.0
    if saved > EQUAL:
        by = f"but for {INT8}, which saves {saved:.0%}: less than the {LEAST_GAIN:.0%} from which on it is taken"
    else:
        by = f"the next takes {longer:.0%} longer" if longer > EQUAL else "another is as fast"
    times = ", ".join(f"{name} {each.shortest * 1e3:.0f} ms" for name, each in timings.items())
    again = "; the machine was busy, so a start an hour later measures again" if busy else ""
    return f"{best} is the fastest here, {by}: {times}{again}"


def for_weights(device: str) -> tuple[Runtime, ...]:
    """Return the installed runtimes for weights on a type of device."""
    return tuple(each for each in FOR_DEVICE.get(device, ("torch",)) if not _missing(each))


def _missing(runtime: Runtime) -> list[str]:
    return [package for package in NEEDS[runtime] if find_spec(package) is None]


def _made(make: Callable[[Runtime], Engine], candidates: Iterable[Runtime]) -> list[tuple[Runtime, Engine]]:
    made: list[tuple[Runtime, Engine]] = []
    for each in candidates:
        try:
            made.append((each, make(each)))
        except Exception as error:  # noqa: BLE001 - whatever ails one library, another one may work
            log.warning("--runtime %s does not work here: %s", each, first_line(error))
    return made


def _memory(place: RuntimeTarget, candidates: Iterable[Runtime]) -> Path:
    """Return the file that keeps the choice; it depends on the candidates, machine, device, GPU and versions."""
    packages = {"torch", "ultralytics"}.union(*(NEEDS[each] for each in candidates))
    here = [place.device, place.gpu, place.threads, platform.node()]
    about = [place.digest, place.longest, *here, *candidates, *installed(packages)]
    return place.cache / f"choice-{hashlib.sha256(repr(about).encode()).hexdigest()[:32]}"


def _recall(memory: Path) -> Runtime | None:
    try:
        text = memory.read_text(encoding="ascii")
        age_s = time.time() - memory.stat().st_mtime
    except (OSError, UnicodeDecodeError):
        return None
    named, _, mark = text.partition("\n")
    kept_s = KEPT_BUSY_S if mark == BUSY_MARK else KEPT_S
    return next((each for each in NEEDS if each == named), None) if 0 <= age_s < kept_s else None


def _remember(memory: Path, runtime: Runtime, *, busy: bool) -> None:
    try:
        memory.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=MAKING, dir=memory.parent) as folder:
            made = Path(folder) / memory.name
            made.write_text(f"{runtime}\n{BUSY_MARK}" if busy else runtime, encoding="ascii")
            made.replace(memory)
    except OSError as error:
        log.warning("%s is measured again at the next start: --cache %s: %s", runtime, memory.parent, error.strerror)
