"""Images are inferred, dropped by somebody for a reason, or unattributed."""

import msgspec

from benchmarks.chaos.frames import frames
from benchmarks.chaos.observer import FRONT, Seen
from schemas.status import MISSING, OVER_BUDGET, CameraLoad, GatewayStatus, StreamStatus, WorkerStatus


def gateway(boot: str, received: int, *, over: int = 0) -> GatewayStatus:
    color = StreamStatus(
        camera=FRONT.camera, stream="color", topic="/c", wanted=True, publishers=1, received=received, forwarded=0
    )
    depth = StreamStatus(
        camera=FRONT.camera, stream="depth", topic="/d", wanted=True, publishers=1, received=999, forwarded=0
    )
    streams = [msgspec.structs.replace(color, dropped={OVER_BUDGET: over})]
    return GatewayStatus(robot=FRONT.robot, boot_id=boot, clock_id="c", sent_ns=1, streams=[*streams, depth])


def worker(name: str, inferred: int, missing: int = 0) -> WorkerStatus:
    load = CameraLoad(robot=FRONT.robot, camera=FRONT.camera, inferred=inferred, dropped={MISSING: missing})
    return WorkerStatus(service="detector", worker=name, model="m", sent_ns=1, cameras=[load])


def test_every_image_between_two_moments_is_counted_once() -> None:
    seen = Seen()
    seen.gateway(gateway("b1", 10))
    seen.worker(worker("w1", 8))
    before = frames(seen)
    seen.gateway(gateway("b1", 20, over=3))
    seen.gateway(gateway("b2", 5))
    seen.worker(worker("w1", 12, missing=4))
    seen.worker(worker("w2", 6))
    between = frames(seen) - before
    assert between.figures() == {
        "received": 15,
        "inferred": 10,
        "dropped": {"at the gateway: over the uplink budget": 3, "on the link: lost": 1},
        "unattributed": 1,
    }
