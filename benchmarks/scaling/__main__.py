"""How detector workers share 64 cameras at 10 Hz, each a real process, over a real Zenoh router, in about 3 minutes.

The model is a stand-in that takes 50 ms per frame, whatever the batch, so that eight workers are flooded four times
over. Cameras are one process that offers them as gateways do and sends by the gateway's own rules on who can use how
much. All figures are from the arrival times of class lists at one subscriber, but for frames sent, which the cameras
count.

    efficiency_8     results/s of eight workers over eight times those of one
    double_owned     cameras with results of more than one worker at rest; unowned: with none
    max_share        the most cameras of one worker over the even share
    useful_fraction  frames with results over frames sent, at eight workers
    max_age_ms       from when the gateway had a frame to when its result arrived
    failover_s       from SIGKILL until each camera of that worker had results again; moved_others: other cameras that
                     went to another worker
    hang_failover_s  the same from SIGSTOP; woken_double_s: how long after SIGCONT results came from both owners
    join_gap_s       a worker joins: how much longer than usual a camera had no result on its way from one worker to
                     another. A flooded worker comes to each camera every third of a second or so: *_interval_s is the
                     whole time, *_usual_interval_s the median one before
    rolling_gap_s    the same while all workers are restarted in turn; exit_s: how long one took to end at most
"""

import signal
import sys
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.peers.fleet_cameras import SEED
from benchmarks.progress import note
from benchmarks.scaling.scenario import CAMERAS, FRAME_MS, HZ, ROBOTS, WORKERS, Scenario, scenario
from benchmarks.scaling.targets import targets

NAMES: Final = [f"w{number}" for number in range(1, WORKERS + 1)]


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.scaling", __doc__)
    parser.add_argument("--seconds", type=float, default=15.0, help="length of a measurement at rest (default: 15)")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    with scenario() as fleet:
        found = measure(fleet, arguments.seconds)
    show(found, as_json=arguments.json)


def measure(fleet: Scenario, seconds: float) -> dict[str, Any]:
    """Do everything."""
    note("one worker")
    fleet.start(NAMES[0])
    one = fleet.calm(seconds)
    note(f"{one}\n{WORKERS - 1} workers")
    fleet.start(*NAMES[1:-1])
    seven = fleet.calm(seconds / 3)
    note(f"{seven}\none more joins")
    found = fleet.join(NAMES[-1])
    note(f"{found}\n{WORKERS} workers")
    eight = fleet.calm(seconds)
    note(f"{eight}\none is killed")
    found |= eight | fleet.crash(NAMES[1])
    fleet.start(NAMES[1])
    fleet.settle()
    note(f"{found}\none hangs")
    found |= fleet.hang(NAMES[2])
    fleet.settle()
    found |= fleet.roll()
    found["one_worker_results_per_s"] = one["results_per_s"]
    found["one_worker_useful_fraction"] = one["useful_fraction"]
    found["efficiency_8"] = round(eight["results_per_s"] / WORKERS / one["results_per_s"], 3)
    return {
        "targets": targets(found),
        **found,
        "workers": WORKERS,
        "cameras": ROBOTS * CAMERAS,
        "hz": HZ,
        "frame": "64x48 rgb8",
        "frame_ms": FRAME_MS,
        "seconds": seconds,
        "machine": machine(),
        "versions": versions(["eclipse-zenoh", "msgspec"]),
        "seeds": [SEED],
    }


if __name__ == "__main__":
    main()
