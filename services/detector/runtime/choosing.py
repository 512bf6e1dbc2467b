"""Chooses a model's runtime: the requested one, or the fastest of those installed, by measuring."""

import hashlib
import logging
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.model import ModelError
from services.detector.runtime.engine import Engine, Runtime
from services.detector.runtime.exporting import MAKING, installed

log = logging.getLogger(__name__)

NEEDS: Final[Mapping[Runtime, tuple[str, ...]]] = {
    "torch": (),
    "onnx": ("onnx", "onnxruntime"),
    "openvino": ("onnx", "openvino"),
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
ROUNDS: Final = 6
REPEATS: Final = 2
KEPT_S: Final = 7 * 24 * 3600
"""How long a choice is kept: one that was made while something else kept the machine busy is not for ever."""


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


def choose(make: Callable[[Runtime], Engine], place: RuntimeTarget, blank: NDArray[np.uint8]) -> tuple[Runtime, Engine]:
    """Return the fastest runtime for a device and the model under it. Measurements are kept for a week.

    What was the fastest and no longer works is left out, with a warning.

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
    times = measure(engines, blank)
    best = min(times, key=times.__getitem__)
    log.info("%s is the fastest here: %s", best, ", ".join(f"{each} {t * 1e3:.0f} ms" for each, t in times.items()))
    _remember(memory, best)
    return best, engines[best]


def measure(engines: Mapping[Runtime, Engine], blank: NDArray[np.uint8]) -> dict[Runtime, float]:
    """Return the shortest time in seconds that each runtime takes for a batch, measured in turn.

    The first of each turn does not count: another library's threads may still be spinning.
    """
    best = dict.fromkeys(engines, float("inf"))
    for _ in range(ROUNDS):
        for name, engine in engines.items():
            engine.run(blank)
            for _ in range(REPEATS):
                began = time.perf_counter()
                engine.run(blank)
                best[name] = min(best[name], time.perf_counter() - began)
    return best


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
            log.warning("not with --runtime %s: %s", each, error)
    return made


def _memory(place: RuntimeTarget, candidates: Iterable[Runtime]) -> Path:
    """Return the file that keeps the choice; it depends on the machine, device, GPU and versions."""
    packages = {"torch", "ultralytics"}.union(*(NEEDS[each] for each in candidates))
    here = [place.device, place.gpu, place.threads, platform.node()]
    about = [place.digest, place.longest, *here, *installed(packages)]
    return place.cache / f"choice-{hashlib.sha256(repr(about).encode()).hexdigest()[:32]}"


def _recall(memory: Path) -> Runtime | None:
    try:
        if not 0 <= time.time() - memory.stat().st_mtime < KEPT_S:
            return None
        text = memory.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        return None
    return next((each for each in NEEDS if each == text), None)


def _remember(memory: Path, runtime: Runtime) -> None:
    try:
        memory.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=MAKING, dir=memory.parent) as folder:
            made = Path(folder) / memory.name
            made.write_text(runtime, encoding="ascii")
            made.replace(memory)
    except OSError as error:
        log.warning("%s is measured again at the next start: --cache %s: %s", runtime, memory.parent, error.strerror)
