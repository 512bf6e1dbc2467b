"""Depth stamped in the future, at a distance worker."""

from concurrent.futures import ThreadPoolExecutor

from bus import QUEUE
from bus.fake import FakeNetwork
from schemas.distances import Distances
from schemas.keys import Stream
from services.geometry.joining import FLUSHED
from tests.services.distance.rig import FRONT, load, only, receive, robot, working
from tests.services.distance.scenes import depth, detections, found, mask, stamp_of, wall

HOUR_NS = 3_600 * 10**9
BOX = found(mask(slice(10, 30), slice(20, 50)))


async def test_depth_from_the_future_is_joined_with_nothing_and_does_not_stay_in_the_way() -> None:
    network = FakeNetwork()
    with ThreadPoolExecutor(1) as executor:
        async with (
            network.open_bus() as theirs,
            network.open_bus() as ours,
            robot(theirs) as front,
            working(ours, executor),
            theirs.subscribe(FRONT.stream(Stream.DISTANCES), QUEUE(9)) as distances,
        ):
            await front.until_wanted()
            front.send(Stream.DEPTH, depth(wall(9.0), 1, stamp_ns=stamp_of(1) + HOUR_NS))
            front.send(Stream.DETECTIONS, detections(BOX, 1))
            axial_m, reason = only(await receive(distances, Distances))
            assert axial_m is None
            assert reason == "no depth image of its instant: the nearest is 3600.000 s after it"
            for seq in (2, 3):
                front.send(Stream.DEPTH, depth(wall(2.0), seq))
                front.send(Stream.DETECTIONS, detections(BOX, seq))
                assert only(await receive(distances, Distances)) == (2.0, "")
            account = await load(theirs, lambda of: of.inferred == 2)
    assert account.dropped == {f"depth image: {FLUSHED}": 1, "no depth image of the same instant": 1}
