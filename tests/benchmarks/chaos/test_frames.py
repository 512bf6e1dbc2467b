"""Images are inferred, dropped by somebody for a reason, lost on the way, or unattributed."""

from benchmarks.chaos.frames import frames
from benchmarks.chaos.observer import FRONT, Seen
from schemas.status import MISSING, OVER_BUDGET, CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.detector.frame_counts import REPLACED


def stream(name: str, received: int, forwarded: int, over: int = 0) -> StreamStatus:
    return StreamStatus(
        camera=FRONT.camera,
        stream=name,
        topic="/topic",
        wanted=True,
        publishers=1,
        received=received,
        forwarded=forwarded,
        dropped={OVER_BUDGET: over},
    )


def gateway(boot: str, received: int, forwarded: int, over: int = 0) -> GatewayStatus:
    streams = [stream("color", received, forwarded, over), stream("depth", 999, 999)]
    return GatewayStatus(robot=FRONT.robot, boot_id=boot, clock_id="c", sent_ns=1, streams=streams)


def worker(name: str, inferred: int, replaced: int = 0, *, service: str = "detector") -> WorkerStatus:
    dropped = {MISSING: 999, REPLACED: replaced}
    load = CameraLoad(robot=FRONT.robot, camera=FRONT.camera, inferred=inferred, dropped=dropped)
    return WorkerStatus(service=service, worker=name, model="m", sent_ns=1, cameras=[load])


def test_every_image_between_two_moments_is_counted_once() -> None:
    seen = Seen()
    seen.gateway(gateway("b1", 10, 10))
    seen.worker(worker("w1", 10))
    before = frames(seen)
    seen.gateway(gateway("b1", 20, 16, over=3))
    seen.gateway(gateway("b2", 5, 5))
    seen.worker(worker("w1", 12, replaced=1))
    seen.worker(worker("w2", 6))
    seen.worker(worker("d1", 50, service="distance"))
    between = frames(seen) - before
    assert between.figures() == {
        "received": 15,
        "inferred": 8,
        "dropped": {"at the gateway: over the uplink budget": 3, "at the detector: replaced by a newer frame": 1},
        "never_came": 2,
        "unattributed": 1,
    }
