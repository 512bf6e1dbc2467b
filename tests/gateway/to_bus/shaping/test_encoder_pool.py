import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np

from gateway.to_bus.shaping.compression import LOSSY, NONE
from gateway.to_bus.shaping.encoder_pool import EncodeJob, EncoderPool, Shaped
from schemas import codec
from schemas.image import ImageFrame
from tests.gateway.to_bus.shaping.frames import cloud, frame, picture
from tests.schemas.pictures import compressed, file_of
from tests.waiting import until


class Recorder:
    """A client that keeps what it gets."""

    def __init__(self) -> None:
        self.made: list[Shaped] = []
        self.errors: list[str] = []

    def shaped(self, made: Shaped) -> None:
        self.made.append(made)

    def on_error(self, error: Exception) -> None:
        self.errors.append(str(error))


def job(value: int = 0) -> EncodeJob:
    return EncodeJob(frame("rgb8", np.full((4, 6, 3), value, np.uint8)), 1, NONE)


def value_of(made: Shaped) -> int:
    return codec.decode(ImageFrame, made.payload, codec.encoding(ImageFrame)).data[0]


@asynccontextmanager
async def working() -> AsyncIterator[EncoderPool]:
    encoder_pool = EncoderPool()
    running = asyncio.create_task(encoder_pool.run())
    yield encoder_pool
    running.cancel()
    await asyncio.wait([running])


def test_a_job_scales_and_compresses() -> None:
    made = EncodeJob(frame("rgb8", picture()), 2, LOSSY).do()
    arrived = codec.decode(ImageFrame, made.payload, codec.encoding(ImageFrame))
    assert (arrived.height, arrived.width, arrived.format, str(made.method)) == (24, 32, "jpeg", "jpeg:80")
    assert str(EncodeJob(cloud(), 2, LOSSY).do().method) == "zstd:1"


async def test_frames_come_back_in_order() -> None:
    client = Recorder()
    async with working() as encoder_pool:
        for value in range(5):
            assert encoder_pool.submit(client, job(value)) == 0
            await until(lambda value=value: len(client.made) == value + 1, "it is shaped")  # type: ignore[misc]
            assert not encoder_pool.is_busy_for(client)
    assert [value_of(made) for made in client.made] == [0, 1, 2, 3, 4]


async def test_of_each_client_the_newest_waits_and_all_are_served_in_turn() -> None:
    one, other = Recorder(), Recorder()
    encoder_pool = EncoderPool()
    assert [encoder_pool.submit(one, job(value)) for value in range(3)] == [0, 1, 1]
    assert encoder_pool.submit(other, job(9)) == 0
    assert encoder_pool.is_busy_for(one)
    running = asyncio.create_task(encoder_pool.run())
    await until(lambda: one.made and other.made, "both are served")
    running.cancel()
    await asyncio.wait([running])
    assert [value_of(made) for made in (*one.made, *other.made)] == [2, 9]


async def test_a_frame_that_cannot_be_shaped_spoils_itself_only() -> None:
    client = Recorder()
    file = compressed(file_of(picture(4, 6), ".png"), "rgb8", 18)
    async with working() as encoder_pool:
        encoder_pool.submit(client, EncodeJob(file, 2, LOSSY))
        await until(lambda: client.errors, "it is spoilt")
        encoder_pool.submit(client, job(7))
        await until(lambda: client.made, "the next one is shaped")
    (error,) = client.errors
    assert error.startswith("a png that arrived as one cannot be scaled")


async def test_who_left_is_told_nothing() -> None:
    gone, other = Recorder(), Recorder()
    async with working() as encoder_pool:
        for served in (False, True):
            encoder_pool.submit(gone, EncodeJob(frame("rgb8", picture(1000, 1000)), 1, LOSSY))
            if served:
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            encoder_pool.submit(gone, job())
            assert encoder_pool.leave(gone) == 1 + served
            assert not encoder_pool.is_busy_for(gone)
        encoder_pool.submit(other, job())
        await until(lambda: other.made, "the other one is served")
    assert not gone.made
    assert not gone.errors
