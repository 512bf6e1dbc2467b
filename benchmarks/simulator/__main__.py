"""How fast the simulated warehouse is on one core, in one process of one thread; some seconds.

Views of 640x480 pixels at even distances along the drives of several scenes. A frame is an exact rendering in colour
with its depth (render), what the robot's motion at 1 m/s smears (smear), the faults of the colour camera (expose) and
those of the depth camera (depth). Beside it:

    cloud        the organised cloud of the measured depth
    geometry     depth and instances without colour, as an unregistered depth camera needs them
    lidar        one turn of 16 x 1800 rays
    truth        the masks of everything in view
    visibility   how much is hidden of each object with at least 0.1 % of the image

Milliseconds are processor time, so that a busy machine does not count; so are those that frames_per_s_one_core is the
inverse of: what a core of its own renders. frames_per_s_wall is what the machine left over in this run.
"""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.simulator.report import report
from benchmarks.simulator.stages import measure

SEEDS: Final = (3, 704, 9000, 12345, 500_000)
POSES: Final = 8
THREAD_LIMITS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.simulator", __doc__)
    parser.add_argument("--poses", type=int, default=POSES, help=f"views of each scene (default: {POSES})")
    arguments = parser.parse_args()
    found = run(arguments.poses)
    show(found, as_json=arguments.json)


def run(poses: int) -> dict[str, Any]:
    """Measure in a process of its own, whose libraries find that they may have one thread."""
    os.environ.update(dict.fromkeys(THREAD_LIMITS, "1"))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        times = process.submit(measure, list(SEEDS), poses).result()
    return {
        **report(times),
        "frame": "640x480",
        "seeds": SEEDS,
        "poses": poses,
        "machine": machine(),
        "versions": versions(["numpy", "opencv-python-headless"]),
    }


if __name__ == "__main__":
    main()
