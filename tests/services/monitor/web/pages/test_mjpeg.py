"""Overlays as MJPEG streams."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import cv2
import numpy as np
import pytest
from starlette.types import Message, Scope

from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from services.monitor.live_views.newest import Newest, Pictures
from services.monitor.live_views.shared import SharedSubscriptions
from services.monitor.web.auth.users import STATE, Role, Visitor
from services.monitor.web.pages.mjpeg import BOUNDARY, MOST_OF_VISITOR, NOTHING, MjpegStreams, path_of, picture_part
from tests.schemas.frames import image
from tests.schemas.pictures import compressed, file_of

KEY = StreamKey(CameraKey("r1", "front"), Stream.OVERLAY_DETECTION)
JPEG = file_of(np.zeros((4, 6, 3), np.uint8), ".jpg")
FRAME = compressed(JPEG, "rgb8", 18, kind="jpeg")


async def idle(_: StreamKey, __: Newest[ImageFrame]) -> None:
    await asyncio.Event().wait()


class Browser:
    """The other end of the connection: takes what is sent while it is not stuck, until it leaves."""

    def __init__(self) -> None:
        self.got: list[Message] = []
        self.stuck = asyncio.Event()
        self._news = asyncio.Event()
        self._left = asyncio.Event()

    async def receive(self) -> Message:
        await self._left.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: Message) -> None:
        if self.stuck.is_set():
            await asyncio.Event().wait()
        self.got.append(message)
        self._news.set()

    async def until(self, count: int) -> None:
        async with asyncio.timeout(5):
            while len(self.got) < count:
                self._news.clear()
                await self._news.wait()

    def leave(self) -> None:
        self._left.set()


class Door:
    """Whether a visitor may still look."""

    def __init__(self) -> None:
        self.role: Role | None = Role.VIEWER


def scope(camera: str = "front", stream: str = "overlay/detection", door: Door | None = None) -> Scope:
    visitor = Visitor("ann", lambda: (door or Door()).role)
    return {"type": "http", STATE: visitor, "path_params": {"robot": "r1", "camera": camera, "stream": stream}}


@asynccontextmanager
async def shown(
    browser: Browser, door: Door | None = None, **options: float
) -> AsyncIterator[tuple[Pictures, asyncio.Task[None]]]:
    overlays: Pictures = SharedSubscriptions(lambda _: Newest(), idle, most=1)
    picture = MjpegStreams(overlays, **options)
    showing = asyncio.create_task(picture(scope(door=door), browser.receive, browser.send))
    await browser.until(2)
    yield overlays, showing
    browser.leave()
    await asyncio.wait([showing])
    assert overlays.keys == []


async def test_frames_are_parts_and_leaving_ends_it() -> None:
    browser = Browser()
    async with shown(browser) as (overlays, showing):
        newest = overlays.peek(KEY)
        assert newest is not None
        assert browser.got[0]["status"] == 200
        assert NOTHING in browser.got[1]["body"]
        newest.take(FRAME, 1)
        await browser.until(3)
        assert browser.got[2]["body"] == picture_part(FRAME)
        browser.leave()
        await showing
        assert overlays.keys == []


async def test_a_slow_browser_skips_to_the_newest() -> None:
    browser = Browser()
    async with shown(browser) as (overlays, _):
        newest = overlays.peek(KEY)
        assert newest is not None
        later = compressed(file_of(np.full((4, 6, 3), 255, np.uint8), ".jpg"), "rgb8", 18, kind="jpeg")
        for frame in (FRAME, FRAME, later):
            newest.take(frame, 1)
        await browser.until(3)
        assert [message["body"] for message in browser.got[2:]] == [picture_part(later)]


async def test_a_browser_that_takes_nothing_has_gone() -> None:
    browser = Browser()
    async with shown(browser, repeat_s=0.01, gone_s=0.05) as (overlays, showing):
        await browser.until(4)  # sent again, though nothing is new
        browser.stuck.set()
        await showing
        assert overlays.keys == []


async def test_who_is_logged_out_sees_no_more() -> None:
    browser, door = Browser(), Door()
    async with shown(browser, door, repeat_s=0.01) as (overlays, showing):
        door.role = None
        await showing
        assert overlays.keys == []


async def test_a_request_that_is_cancelled_leaves_nothing() -> None:
    browser = Browser()
    async with shown(browser) as (overlays, showing):
        showing.cancel()
        await asyncio.wait([showing])
        assert overlays.keys == []
        assert showing.cancelled()


async def test_too_many_views_are_refused_with_a_reason() -> None:
    browser, second = Browser(), Browser()
    async with shown(browser) as (overlays, _):
        await MjpegStreams(overlays)(scope(camera="rear"), second.receive, second.send)
        assert second.got[0]["status"] == 503
        assert second.got[1]["body"].startswith(b"1 are already open")


@pytest.mark.parametrize(
    ("camera", "stream"), [("front", "color"), ("ros", "overlay/detection"), ("a*", "overlay/detection")]
)
async def test_what_is_no_overlay_of_a_camera_is_not_found(camera: str, stream: str) -> None:
    browser = Browser()
    overlays: Pictures = SharedSubscriptions(lambda _: Newest(), idle, most=1)
    await MjpegStreams(overlays)(scope(camera, stream), browser.receive, browser.send)
    assert browser.got[0]["status"] == 404


def test_a_part_is_a_file_and_the_boundary_after_it() -> None:
    head, _, rest = picture_part(FRAME).partition(b"\r\n\r\n")
    assert head == b"Content-Type: image/jpeg\r\nContent-Length: %d" % len(JPEG)
    assert rest == JPEG + f"\r\n--{BOUNDARY}\r\n".encode()
    decoded = cv2.imdecode(np.frombuffer(rest[: len(JPEG)], np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape == (4, 6, 3)


def test_what_browsers_do_not_show_is_shown_as_nothing() -> None:
    assert NOTHING in picture_part(image())
    assert NOTHING in picture_part(None)


def test_a_browser_finds_an_overlay_by_its_names() -> None:
    assert path_of(KEY) == "/pictures/r1/front/overlay/detection"


async def test_nobody_looks_at_so_many_pictures_that_others_see_none() -> None:
    pictures = MjpegStreams(SharedSubscriptions(lambda _: Newest(), idle, most=1))
    browsers = [Browser() for _ in range(MOST_OF_VISITOR + 1)]
    looking = [asyncio.create_task(pictures(scope(), each.receive, each.send)) for each in browsers]
    for each in browsers:
        await each.until(2)
    starts = [each.got[0]["status"] for each in browsers]
    assert starts == [200] * MOST_OF_VISITOR + [503]
    for each in browsers:
        each.leave()
    await asyncio.wait(looking)
    again = Browser()
    showing = asyncio.create_task(pictures(scope(), again.receive, again.send))
    await again.until(2)
    assert again.got[0]["status"] == 200
    again.leave()
    await asyncio.wait([showing])
