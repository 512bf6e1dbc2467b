"""What happens while one subscriber stands still, its link open: to the gateway, and to another camera.

Two cameras at 30 Hz, each with a subscriber at a link of its own; one of them is stopped.
"""

import time
from contextlib import ExitStack
from typing import Any, Final

from benchmarks.gateway.flow import await_frames, free_endpoint, gateway, subscribing
from benchmarks.gateway.processes import Process, module, running

FRONT: Final = "/front/color/image_raw"
REAR: Final = "/rear/color/image_raw"
LEASE_S: Final = 60.0
"""How long both ends may be silent: neither may give the link up meanwhile, or when it goes on."""

BEFORE_S: Final = 4.0
AFTER_S: Final = 2.0
SAMPLE_S: Final = 0.1


def measure(master: str, seconds: float, *, shared_memory: bool) -> dict[str, Any]:
    """Stop the front camera's subscriber for a while.

    peak_frames_buffered: frames made during the stall that arrive after it, wherever they waited.
    """
    with ExitStack() as stack:
        endpoints = [free_endpoint(), free_endpoint()]
        stalled, other = (
            stack.enter_context(
                subscribing(f"fleet/r1/{name}/color", endpoint, master, shared_memory=shared_memory, lease_s=LEASE_S)
            )
            for name, endpoint in zip(("front", "rear"), endpoints, strict=True)
        )
        camera = stack.enter_context(running(module("camera", "30", FRONT, REAR), master))
        options = ["--cameras", f"front={FRONT},rear={REAR}", "--lease-s", str(LEASE_S)]
        command = gateway(endpoints, master, *options, shared_memory=shared_memory)
        process = stack.enter_context(running(command, master))
        for subscriber in (stalled, other):
            await_frames(subscriber, [process, camera])
        time.sleep(BEFORE_S)
        return _stall(process, camera, stalled, other, seconds)


def _stall(process: Process, camera: Process, stalled: Process, other: Process, seconds: float) -> dict[str, Any]:
    stalled.ask()
    sent, had, rss = camera.ask(), other.ask()["frames"], process.rss_bytes()
    stopped, began = time.time_ns(), time.monotonic()
    stalled.stop()
    peak = rss
    while time.monotonic() < began + seconds:
        time.sleep(SAMPLE_S)
        peak = max(peak, process.rss_bytes())
    elapsed = time.monotonic() - began
    sent_meanwhile = {topic: count - sent[topic] for topic, count in camera.ask().items()}
    had_meanwhile = other.ask()["frames"] - had
    ended = time.time_ns()
    stalled.go_on()
    time.sleep(AFTER_S)
    made = stalled.ask()["sent_ns"]
    return {
        "peak_frames_buffered": sum(stopped < each < ended for each in made),
        "stalled_rss_growth_mb": round((peak - rss) / 1e6, 1),
        "stalled_camera_hz": round(sent_meanwhile[FRONT] / elapsed, 1),
        "other_camera_hz": round(sent_meanwhile[REAR] / elapsed, 1),
        "other_frames_per_s": round(had_meanwhile / elapsed, 1),
        "frames_per_s_after_stall": round(sum(each > ended for each in made) / AFTER_S, 1),
    }
