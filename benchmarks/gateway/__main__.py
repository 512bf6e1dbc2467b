"""The gateway against a rospy one, the least one and Zenoh alone, side by side in one run of about five minutes.

640x480 rgb8 images from a sender to a Zenoh subscriber, each process on its own, flat out and at 30 Hz, with shared
memory on and off; all go the same way: TCP on loopback between two Zenoh peers of the same settings, images at the same
quality of service.

    fleetsight    the gateway as it is started on a robot
    rospy_naive   what one would write first: a rospy subscriber that puts each image on Zenoh
    bare_gateway  the least that a gateway can do: a plain socket receives the ROS topic into one buffer, each message
                  is put on Zenoh as it is, and nothing is read, checked, numbered, counted or bounded
    zenoh_only    a sender that puts images on Zenoh, with no ROS in between: nothing is received, so it flatters Zenoh
    tcpros_only   a plain socket that receives the ROS topic into one buffer: no gateway can have more frames than that,
                  and a target whose `ceiling` is below `at_least` is out of every gateway's reach on this machine

Every sender writes a new image for every frame, out of a pool that no cache holds; ROS's is a plain socket's, the same
for all, since rospy's own is slower than the gateway. Every receiver copies each payload out of what brought it and
reads the time in its pixels; doubles are not counted. Frames per second are those that arrive: what a newer one
replaced on the way is lost. The processes share the machine's cores, so that a variant with one process less, as
zenoh_only is, has more of them for itself.

Processor time is user and system time of the gateway's process over the frames that arrived; a target's `floor` is what
bare_gateway has of it. added_latency_p50_ms is
from when the gateway had the whole frame to the subscriber, less zenoh_only's way from putting to the subscriber.

While a subscriber stands still for ten seconds at a link that nobody gives up, frames are counted that were made
meanwhile and arrive afterwards, wherever they waited. Needs Debian's ROS 1.
"""

from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.gateway import flow, idle, stall
from benchmarks.gateway.processes import ROSMASTER, ros_master
from benchmarks.gateway.report import Run, medians, targets
from benchmarks.machine import machine, versions
from benchmarks.peers.frames import SEED
from benchmarks.progress import note
from bus.session.process_limits import SHAREABLE_BYTES, may_lock

REPEATS: Final = 3
HZ: Final = 30
IDLE_S: Final = 10.0
STALL_S: Final = 10.0
RUNS: Final = [
    run
    for hz in (0, HZ)
    for shared_memory in (True, False)
    for run in (
        Run("fleetsight", hz, shared_memory),
        Run("rospy_naive", hz, shared_memory),
        Run("bare_gateway", hz, shared_memory),
        Run("zenoh_only", hz, shared_memory),
    )
] + [Run("tcpros_only", 0, shared_memory=True)]


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.gateway", __doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="length of one measurement (default: 3)")
    arguments = parser.parse_args()
    if not Path(ROSMASTER).exists():
        parser.error("Debian's ROS 1 is not installed; tests/install/ros.sh installs it")
    if not may_lock(SHAREABLE_BYTES):
        parser.error(
            f"half of it is with shared memory: that takes leave to lock {SHAREABLE_BYTES >> 20} MiB (ulimit -l)"
        )
    found = measure(arguments.seconds)
    show(found, as_json=arguments.json)


def measure(seconds: float) -> dict[str, Any]:
    """Run everything, the repeats in turn."""
    runs: dict[Run, list[flow.Figure]] = {run: [] for run in RUNS}
    with ros_master() as master:
        for repeat in range(REPEATS):
            for run, done in runs.items():
                note(f"[{repeat + 1}/{REPEATS}] {run}")
                done.append(
                    flow.measure(run.variant, master, hz=run.hz, seconds=seconds, shared_memory=run.shared_memory)
                )
        note("nobody listens")
        found = medians(runs) | idle.measure(master, IDLE_S)
        for shared_memory in (True, False):
            note("a subscriber stands still")
            stalled = stall.measure(master, STALL_S, shared_memory=shared_memory)
            found |= {f"{name}{'' if shared_memory else '_no_shm'}": value for name, value in stalled.items()}
    return {
        "targets": targets(found),
        **found,
        "frame": "640x480 rgb8",
        "repeats": REPEATS,
        "seconds": seconds,
        "machine": machine(),
        "versions": versions(["eclipse-zenoh", "msgspec"]),
        "seeds": [SEED],
    }


if __name__ == "__main__":
    main()
