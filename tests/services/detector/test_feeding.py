"""A camera's frames on a fake bus on their way to the frame_queue of a detector."""

import asyncio

from bus import QUEUE, QoS
from bus.fake import FakeNetwork
from bus.sharing.rate_request import RateRequest
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import Stream
from schemas.status import UNWANTED
from services.detector.camera import feed, serving
from services.detector.frame_counts import REPLACED, FrameCounts
from services.detector.frame_queue import FrameQueue
from services.detector.worker_role import DETECTOR
from tests.services.detector.test_worker import FRONT, frame
from tests.waiting import until


async def test_frames_that_wait_unread_or_on_the_board_when_it_ends_are_counted() -> None:
    network, tally, frame_queue = FakeNetwork(), FrameCounts(FRONT), FrameQueue()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as colors,
        theirs.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)),
        serving(ours, FRONT, tally) as camera,
        asyncio.TaskGroup() as group,
    ):
        feeding = group.create_task(feed(ours, camera, frame_queue, RateRequest(), worker="w1", role=DETECTOR))
        await until(lambda: colors.wanted)
        for seq in range(2):
            colors.put(codec.encode(frame(seq)))
            await asyncio.wait_for(frame_queue.filled(1, 0), 5)
        await until(lambda: tally.dropped[REPLACED] == 1)
        feeding.cancel()
        for seq in range(2, 5):
            colors.put(codec.encode(frame(seq)))
        await asyncio.wait([feeding])
    assert +tally.dropped == {REPLACED: 1, UNWANTED: 4}
