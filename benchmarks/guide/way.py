"""One image's way through fleetsight, measured hop by hop, and what of it leaves the robot."""

import asyncio
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from benchmarks.gateway.processes import module, running
from benchmarks.guide.hops import Limit, Seen, table
from benchmarks.guide.limits import link_ms, memcpy_ms, tcp_ms
from benchmarks.guide.scene import Scene
from benchmarks.guide.sets import Arrival, mean_sizes
from benchmarks.guide.sides import Side
from benchmarks.guide.topics import CLASSES, DISTANCE, SEGMENTATION
from schemas.keys import Stream
from services.simulator.topics import Content

HZ: Final = 1.0


async def way(side: Side, guide: Side, scene: Scene, images: int, folder: Path) -> dict[str, Any]:
    """Drive at 1 Hz; return `hops`, the runtime, and the bytes that leave the robot for each set.

    folder: the cache of the detector, which has chosen its runtime there.
    """
    with running(module("fleet_observer", side.endpoint)) as observer:
        await asyncio.to_thread(observer.ask)
        await side.ready()
        stamps = await side.robot.drive(HZ, images / HZ)
        arrivals = side.robot.taken()
        seen = msgspec.convert((await asyncio.to_thread(observer.ask))["seen"], list[Seen])
    frames = _returned([each for each in seen if each.stamp_ns in stamps], arrivals)
    overlay = mean_sizes(arrivals).get(SEGMENTATION)
    await side.quiet()
    await guide.ready()
    await guide.robot.drive(HZ, images / HZ)
    sizes = mean_sizes(guide.robot.taken())
    alone = await asyncio.to_thread(_alone, scene, folder)
    link = await link_ms(side.endpoint, scene.size(Content.COLOR))
    mean = {stream: _mean_size(frames, stream) for stream in Stream}
    limits = await asyncio.to_thread(_limits, scene, mean, overlay, alone)
    return {
        "hops": table(frames, link, limits),
        "hops_images": len(frames),
        "runtime": alone["runtime"],
        "class_list_bytes": mean[Stream.CLASSES],
        "distances_bytes": mean[Stream.DISTANCES],
        "jpeg_overlay_bytes": mean[Stream.OVERLAY_SEGMENTATION],
        "guide_class_list_bytes": sizes.get(CLASSES),
        "guide_distances_bytes": sizes.get(DISTANCE),
        "raw_overlay_bytes": overlay,
    }


def _alone(scene: Scene, folder: Path) -> dict[str, Any]:
    """Return how long the model's stages take for the same pictures with nothing else at work, and its runtime."""
    pictures = folder / "pictures.npy"
    np.save(pictures, scene.pictures)
    with running(module("bare_call", "auto", str(folder), str(pictures))) as bare:
        return bare.ask()


def _returned(frames: list[Seen], arrivals: Sequence[Arrival]) -> list[Seen]:
    """Note when each image's overlay came on ROS."""
    at = {each.stamp_ns: each.at_ns for each in arrivals if each.topic == SEGMENTATION}
    return [replace(frame, returned_ns=at.get(frame.stamp_ns)) for frame in frames]


def _mean_size(frames: Sequence[Seen], stream: Stream) -> int | None:
    sizes = [frame.sizes[stream] for frame in frames if stream in frame.sizes]
    return round(statistics.mean(sizes)) if sizes else None


def _limits(
    scene: Scene, sizes: dict[Stream, int | None], overlay: int | None, alone: dict[str, Any]
) -> dict[str, Limit]:
    picture = scene.size(Content.COLOR)
    tcp = Limit("loopback TCP of the same bytes", tcp_ms(picture))
    copied = Limit("memcpy of the same bytes", memcpy_ms(picture))
    return {
        "camera": tcp,
        "gateway": copied,
        "link": tcp,
        "pre-processing": copied,
        "model": Limit("the bare model call", alone["model"]),
        "post-processing": Limit("the same with nothing else at work", alone["postprocess"]),
        "results": Limit(tcp.what, tcp_ms(sizes[Stream.DETECTIONS] or 1)),
        "overlays": Limit("memcpy of both", memcpy_ms(2 * (overlay or 1))),
        "distance": Limit("memcpy of the depth image", memcpy_ms(scene.size(Content.DEPTH))),
        "cloud": Limit("memcpy of the points", memcpy_ms(scene.size(Content.POINTS))),
        "return to ROS": Limit("loopback TCP of the overlay", tcp_ms(overlay or 1)),
        "monitor": Limit("loopback TCP of the class list", tcp_ms(sizes[Stream.CLASSES] or 1)),
    }
