import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec

from bus import Bus, Publisher, QoS
from bus.fake import FakeNetwork
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.objects import ObjectClouds
from services.monitor.live_views.newest import MOST_LISTS, FrameLists, Newest, clouds, pictures
from tests.schemas.frames import header, image
from tests.schemas.results import clouds as object_clouds
from tests.services.monitor.inventory.seeing import seen
from tests.waiting import until

KEY = StreamKey(CameraKey("r1", "front"), Stream.OVERLAY_DETECTION)


@asynccontextmanager
async def monitor_and_detector() -> AsyncIterator[tuple[Bus, Publisher]]:
    network = FakeNetwork()
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        theirs.publisher(str(KEY), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as publisher,
    ):
        yield ours, publisher


async def test_an_overlay_is_wanted_while_somebody_looks() -> None:
    async with monitor_and_detector() as (bus, detector):
        overlays = pictures(bus)
        assert not detector.wanted
        async with overlays.hold(KEY) as newest, overlays.hold(KEY):
            await until(lambda: detector.wanted)
            detector.put(codec.encode(image(seq=7)))
            assert (await newest.after(0)).header.seq == 7
            assert newest.number == 1
            assert newest.received_ns
        await until(lambda: not detector.wanted)


async def test_what_is_no_picture_of_the_camera_is_left_out_and_said() -> None:
    async with monitor_and_detector() as (bus, detector), pictures(bus).hold(KEY) as newest:
        await until(lambda: detector.wanted)
        detector.put(b"no picture")
        await until(lambda: newest.problem)
        assert "not a ImageFrame" in newest.problem
        detector.put(codec.encode(msgspec.structs.replace(image(), header=header(camera="rear"))))
        await until(lambda: "r1/rear" in newest.problem)
        assert newest.number == 0
        detector.put(codec.encode(image()))
        await newest.after(0)
        assert newest.problem == ""


async def test_who_is_slow_gets_the_newest() -> None:
    newest = Newest[ImageFrame]()
    waiting = asyncio.create_task(newest.after(1))
    newest.take(image(seq=1), 1)
    await asyncio.sleep(0)
    assert not waiting.done()
    newest.take(image(seq=2), 2)
    newest.take(image(seq=3), 3)
    assert (await waiting).header.seq == 3
    assert (newest.number, newest.received_ns) == (3, 3)
    assert (await newest.after(0)).header.seq == 3


def test_what_was_counted_in_a_frame_is_found_by_the_frame_and_the_oldest_is_forgotten() -> None:
    lists = FrameLists()
    for seq in range(MOST_LISTS + 1):
        lists.take(seen(seq, {"box": seq}), 1)
    newest = lists.of(seen(MOST_LISTS, {}).header)
    assert newest is not None
    assert newest.classes[0].count == MOST_LISTS
    assert lists.of(seen(0, {}).header) is None
    assert lists.of(seen(5, {}, boot_id="another").header) is None


async def test_object_clouds_are_looked_at_the_same_way() -> None:
    network = FakeNetwork()
    key = StreamKey(CameraKey("r1", "front"), Stream.OBJECTS)
    async with network.open_bus() as ours, network.open_bus() as theirs:
        encoding = codec.encoding(ObjectClouds)
        async with (
            theirs.publisher(str(key), QoS.IMAGE, encoding=encoding) as worker,
            clouds(ours).hold(key) as newest,
        ):
            await until(lambda: worker.wanted)
            worker.put(codec.encode(object_clouds()))
            assert (await newest.after(0)).header.robot == "r1"
