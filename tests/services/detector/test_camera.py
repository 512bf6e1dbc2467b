"""What a camera's results become while somebody wants them."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import numpy as np
import pytest
import simplejpeg

from bus import QUEUE, Bus
from bus.fake import FakeNetwork
from schemas.detections import Detections, Mask
from schemas.image import ImageFrame
from schemas.keys import Stream
from services.detector.camera import CameraOutputs, serving
from services.detector.frame_counts import FrameCounts
from tests.services.detector.support.requests import FRONT, frame_of
from tests.services.detector.test_overlay import HEIGHT, INSIDE, WIDTH, found, grey
from tests.waiting import receive, until

DETECTION, SEGMENTATION = Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION
NEEDS_MASKS = {Stream.CLASSES: False, DETECTION: False, Stream.DETECTIONS: True, SEGMENTATION: True}


@asynccontextmanager
async def camera(*, segments: bool = True) -> AsyncIterator[tuple[Bus, CameraOutputs]]:
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        serving(ours, FRONT, FrameCounts(FRONT), segments=segments) as made,
    ):
        yield theirs, made


def looked_at(seq: int) -> tuple[Detections, ImageFrame]:
    frame = frame_of(grey(), seq=seq)
    return found(INSIDE, frame=frame), frame


@pytest.mark.parametrize("stream", [DETECTION, SEGMENTATION])
async def test_an_overlay_is_drawn_while_somebody_looks(stream: Stream) -> None:
    async with camera() as (bus, made):
        assert not made.demand.wanted
        async with bus.subscribe(FRONT.stream(stream), QUEUE(9)) as overlays:
            await until(lambda: made.demand.wanted)
            made.publish_objects(*looked_at(3))
            drawn = await receive(overlays, ImageFrame)
        assert (drawn.header.seq, drawn.format) == (3, "jpeg")
        await until(lambda: not made.demand.wanted)


async def test_both_overlays_are_drawn_of_the_same_frame() -> None:
    async with (
        camera() as (bus, made),
        bus.subscribe(FRONT.stream(DETECTION), QUEUE(9)) as plain,
        bus.subscribe(FRONT.stream(SEGMENTATION), QUEUE(9)) as masked,
    ):
        await until(lambda: made.overlays.wanted and made.overlays.wants_masks)
        made.publish_objects(*looked_at(3))
        drawn = [await receive(each, ImageFrame) for each in (plain, masked)]
    assert [each.header.seq for each in drawn] == [3, 3]
    insides = [simplejpeg.decode_jpeg(each.data)[70, 70] for each in drawn]
    assert [bool(np.ptp(inside) > 50) for inside in insides] == [False, True]


async def test_a_frame_that_cannot_be_drawn_ends_no_camera(caplog: pytest.LogCaptureFixture) -> None:
    damaged = msgspec.structs.replace(INSIDE, mask=Mask((HEIGHT, WIDTH), "1"))
    async with camera() as (bus, made), bus.subscribe(FRONT.stream(SEGMENTATION), QUEUE(9)) as overlays:
        await until(lambda: made.demand.wanted)
        _, frame = looked_at(3)
        made.publish_objects(found(damaged, frame=frame), frame)
        await until(lambda: "no overlay/segmentation of frame 3" in caplog.text)
        made.publish_objects(*looked_at(4))
        assert (await receive(overlays, ImageFrame)).header.seq == 4


async def test_of_frames_that_wait_to_be_drawn_the_newest_is() -> None:
    async with camera() as (bus, made), bus.subscribe(FRONT.stream(DETECTION), QUEUE(9)) as overlays:
        await until(lambda: made.demand.wanted)
        for seq in range(4):
            made.publish_objects(*looked_at(seq))
        assert (await receive(overlays, ImageFrame)).header.seq == 3


async def test_masks_are_wanted_by_detections_and_the_segmentation_overlay() -> None:
    async with camera() as (bus, made):
        for stream, masks in NEEDS_MASKS.items():
            async with bus.subscribe(FRONT.stream(stream), QUEUE(9)):
                await until(lambda: made.demand.wanted)
                assert made.wants_masks is masks, stream
            await until(lambda: not made.demand.wanted)


async def test_tracks_are_wanted_by_all_that_shows_them_and_not_by_lists_of_classes() -> None:
    async with camera() as (bus, made):
        for stream in NEEDS_MASKS:
            async with bus.subscribe(FRONT.stream(stream), QUEUE(9)):
                await until(lambda: made.demand.wanted)
                assert made.wants_tracks is (stream is not Stream.CLASSES), stream
            await until(lambda: not made.demand.wanted)


async def test_without_masks_there_is_no_segmentation_to_want() -> None:
    async with camera(segments=False) as (bus, made), bus.subscribe(FRONT.stream(SEGMENTATION), QUEUE(9)):
        await asyncio.sleep(0.05)
        assert not made.demand.wanted
