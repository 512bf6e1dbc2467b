"""How long detections wait for odometry at a cloud worker, worked out by what arrives when.

A lidar turns ten times a second, a camera takes 30 pictures, each stamped when it is whole. What the cloud service
waits for is joined as in its worker, beside a robot without odometry. No clock is read.

    python -m benchmarks.space.waits
"""

import json
from collections.abc import Iterator
from heapq import merge
from itertools import product
from typing import Final

import numpy as np
from msgspec.structs import replace

from benchmarks.space.messages import STAMP_NS, cloud_of, detections_of, header, transforms_of
from bus.sharing.work_counts import Tally
from schemas.keys import CameraKey
from services.cloud.waiting import CloudJoiner
from services.simulator.placement import BASE, COLOR_OPTICAL, LIDAR, ODOM
from services.simulator.world import Camera

ODOMETRY_HZ: Final = (0, 100, 50, 20, 10)
PICTURE: Final = "picture"
POINTS: Final = "points"
PICTURES_HZ: Final = 30
TURNS_HZ: Final = 10
SECONDS: Final = 3
RUNS: Final = 20
"""Each with other times between the streams."""

DETECTED_S: Final = (0.02, 0.05)
"""From a picture's stamp until what was found in it is here."""

ARRIVED_S: Final = 0.01
"""From the stamp of points and of transforms until they are here."""

HERE: Final = np.identity(4)
NO_POINTS: Final = np.zeros((1, 0), [("x", "f4"), ("y", "f4"), ("z", "f4")])
Arrival = tuple[float, str, float]
"""When it is here, what it is, and its stamp: seconds from the beginning."""


def _arrivals(what: str, hz: float, after_s: float, rng: np.random.Generator) -> Iterator[Arrival]:
    first_s = rng.uniform(0, 1 / hz)
    for number in range(int(SECONDS * hz)):
        stamp_s = first_s + number / hz
        yield stamp_s + after_s, what, stamp_s


def waits_ms(odometry_hz: int, detected_s: float) -> list[float]:
    """Return how long the detections of each picture that was answered waited. odometry_hz: 0 for none."""
    return [waited for seed in range(RUNS) for waited in _run(odometry_hz, detected_s, np.random.default_rng(seed))]


def _run(odometry_hz: int, detected_s: float, rng: np.random.Generator) -> list[float]:
    streams = [_arrivals(POINTS, TURNS_HZ, ARRIVED_S, rng), _arrivals(PICTURE, PICTURES_HZ, detected_s, rng)]
    if odometry_hz:
        streams.append(_arrivals(ODOM, odometry_hz, ARRIVED_S, rng))
    waiting = CloudJoiner(Tally(CameraKey("r1", "camera")), target=BASE)
    waiting.transforms(transforms_of([(BASE, COLOR_OPTICAL, HERE), (BASE, LIDAR, HERE)]), static=True)
    waited = []
    for now_s, what, stamp_s in merge(*streams):
        _take(waiting, what, STAMP_NS + round(stamp_s * 1e9), now_s)
        while (matched := waiting.take(now_s)) is not None:
            waited.append(1e3 * matched.waited_s)
    return waited


def _take(waiting: CloudJoiner, what: str, stamp_ns: int, now_s: float) -> None:
    if what == PICTURE:
        head = replace(header(COLOR_OPTICAL, stamp_ns), seq=stamp_ns // 1_000_000)
        waiting.detections(detections_of([], Camera(), head), now_s)
    elif what == POINTS:
        waiting.points(cloud_of(NO_POINTS, header(LIDAR, stamp_ns)))
    else:
        waiting.transforms(transforms_of([(ODOM, BASE, HERE)], stamp_ns), static=False)


def main() -> None:
    """Print the waits in milliseconds, a line for each of DETECTED_S and rate of odometry."""
    for detected_s, hz in product(DETECTED_S, ODOMETRY_HZ):
        print(json.dumps({"detected_s": detected_s, "odometry_hz": hz, **_spread(waits_ms(hz, detected_s))}))


def _spread(ms: list[float]) -> dict[str, float]:
    share = len(ms) / (RUNS * SECONDS * PICTURES_HZ)
    return {
        "answered": round(share, 2),
        "mean": round(float(np.mean(ms)), 1),
        "p95": round(float(np.percentile(ms, 95)), 1),
    }


if __name__ == "__main__":
    main()
