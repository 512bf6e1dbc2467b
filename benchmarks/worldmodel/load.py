"""How many views a second one core takes in, against many known objects: made-up views of a very large hall."""

import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from benchmarks.progress import note
from schemas import codec
from schemas.distances import REACHES, CameraView, DepthGrid, ViewedObject
from schemas.header import Header
from services.worldmodel.model import SiteModel
from services.worldmodel.site import AT_ONCE

NS: Final = 1_000_000_000
AISLE_M: Final = 1.0
RANGE_M: Final = 3.0
COLUMNS, ROWS = 40, 30
FOCAL: Final = 29.0
"""In cells, of a camera 69 degrees wide."""


@dataclass(frozen=True, slots=True)
class Load:
    """So many cameras, views a second of each, objects a view, and objects known before; for so many seconds."""

    cameras: int = 1_000
    hz: float = 2.0
    objects: int = 15
    known: int = 20_000
    seconds: int = 10


def measured_apart(load: Load) -> dict[str, Any]:
    """Measure the load in a process of its own, whose memory is the model's alone.

    Raises:
        OSError: that process cannot be started.
    """
    command = [sys.executable, "-m", "benchmarks.worldmodel.load", json.dumps(asdict(load))]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measure_load(load: Load) -> dict[str, Any]:
    """Take in views as they would come, one after the other evenly, and return how far behind the model was."""
    hall = _Hall(load)
    model = SiteModel()
    decode = msgspec.msgpack.Decoder(CameraView).decode
    for sweep in range(3):  # three sightings confirm an object
        for camera in range(hall.cameras_for_all):
            model.take(decode(hall.view(camera, sweep)), (1 + sweep) * NS)
    note(f"load: {len(model.objects.known())} objects known")
    payloads = [hall.view(camera, 3) for camera in range(load.cameras)]
    lags, took = _lags(load, model, payloads, decode)
    return {
        "lag_p50_ms": round(float(np.percentile(lags, 50)) * 1e3, 1),
        "lag_p99_ms": round(float(np.percentile(lags, 99)) * 1e3, 1),
        "busy_share": round(took / load.seconds, 3),
        "views_per_s": round(load.cameras * load.hz),
        "sightings_per_s": round(load.cameras * load.hz * load.objects),
        "most_sightings_per_s": round(load.cameras * load.hz * load.objects * load.seconds / took),
        "known_objects": len(model.objects.known()),
        "rss_mb": peak_rss_mb(),
    }


def peak_rss_mb() -> int:
    """Return the most memory that this process had, in MB; what the system's usage says is also of what started it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return round(int(line.split()[1]) / 1024)


def _lags(load: Load, model: SiteModel, payloads: list[bytes], decode: Any) -> tuple[list[float], float]:
    """Return how long after it came each view was taken in, and the seconds of work, of a queue without a clock."""
    rate = load.cameras * load.hz
    total = round(rate * load.seconds)
    lags: list[float] = []
    free_s = took_s = 0.0
    first = 0
    while first < total:
        waiting = int(max(free_s, first / rate) * rate) + 1 - first
        numbers = range(first, min(first + max(1, min(waiting, AT_ONCE)), total))
        began = time.perf_counter()
        views = [(decode(payloads[number % len(payloads)]), 10 * NS + round(number / rate * NS)) for number in numbers]
        model.take_all(views)
        spent = time.perf_counter() - began
        free_s = max(free_s, numbers[-1] / rate) + spent
        took_s += spent
        lags += [free_s - number / rate for number in numbers]
        first = numbers[-1] + 1
    return lags, took_s


class _Hall:
    """A hall of blocks of boxes, three rows deep, each before a camera's place."""

    def __init__(self, load: Load) -> None:
        self._objects = load.objects
        self.cameras_for_all = -(-load.known // load.objects)
        self._side = int(np.ceil(np.sqrt(self.cameras_for_all)))

    def view(self, camera: int, sweep: int) -> bytes:
        """Return what a camera sees at a sweep, encoded: the boxes of its block."""
        block = camera % self.cameras_for_all
        left, front = (block % self._side) * BLOCK_M, (block // self._side) * BLOCK_M
        across = -(-self._objects // DEEP)
        numbers = np.arange(self._objects)
        x = (numbers % across - (across - 1) / 2) * AISLE_M
        z = RANGE_M + (numbers // across) * AISLE_M
        noise = np.random.default_rng([camera, sweep]).normal(0, 0.01, (self._objects, 2))
        seen = [
            self._object(index, left, front, float(ox + dx), float(oz + dz))
            for index, (ox, oz, (dx, dz)) in enumerate(zip(x.tolist(), z.tolist(), noise, strict=True))
        ]
        header = Header(
            robot=f"r{camera}",
            camera="front",
            boot_id="load",
            seq=sweep,
            stamp_ns=1 + sweep * NS,
            frame_id="optical",
            received_ns=1,
        )
        grid = memoryview(np.full(COLUMNS * ROWS, round(RANGE_M * 1000), "<u2").tobytes())
        made = CameraView(
            header=header,
            frame_id="map",
            position=(left, front, EYE_M),
            rotation=LOOKING_ALONG_Y,
            grid=DepthGrid(
                columns=COLUMNS, rows=ROWS, fx=FOCAL, fy=FOCAL, cx=COLUMNS / 2, cy=ROWS / 2, near_mm=grid, far_mm=grid
            ),
            objects=seen,
            model="load",
            worker="load",
        )
        return bytes(codec.encode(made))

    @staticmethod
    def _object(index: int, left: float, front: float, x: float, z: float) -> ViewedObject:
        column, half = COLUMNS / 2 + FOCAL * x / z, FOCAL * REACH_M / z
        row = ROWS / 2 + FOCAL * EYE_M / z
        return ViewedObject(
            name="box",
            score=0.9,
            index=index,
            box=(column - half, row - 2 * half, column + half, row),
            depth_m=z,
            spread_m=0.05,
            at=(left + x, front + z, REACH_M),
            reach_mm=[round(REACH_M * 1000)] * REACHES,
            low_m=0.0,
            high_m=2 * REACH_M,
        )


EYE_M: Final = 0.8
REACH_M: Final = 0.2
DEEP: Final = 3
BLOCK_M: Final = 12.0

LOOKING_ALONG_Y: Final = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""The optical frame's z axis along the map's y, its y axis down."""


if __name__ == "__main__":
    print(json.dumps(measure_load(Load(**json.loads(sys.argv[1])))))
