"""Overlays as MJPEG streams."""

import asyncio
from collections import Counter
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager, suppress
from typing import Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from schemas.compression import JPEG, PNG
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from services.monitor.live_views.newest import OVERLAYS, Newest, Pictures
from services.monitor.live_views.shared import CrowdedError
from services.monitor.web.auth.users import Visitor, visitor_of

PATH: Final = "/pictures/{robot}/{camera}/{stream:path}"
BOUNDARY: Final = "frame"
KINDS: Final = {JPEG: "image/jpeg", PNG: "image/png"}

NOTHING: Final = (
    b"GIF89a\x01\x00\x01\x00\x80\x00\x00\x00\x00\x00\xff\xff\xff!\xf9\x04\x01\x00\x00\x00\x00"
    b",\x00\x00\x00\x00\x01\x00\x01\x00\x00\x02\x02D\x01\x00;"
)
"""A transparent pixel, sent until the first frame arrives."""

REPEAT_S: Final = 5.0
"""Seconds after which the last frame is sent again: only a failed send reveals that a browser vanished."""

GONE_S: Final = 10.0
"""Seconds after which a client that takes no data counts as gone."""

MOST_OF_VISITOR: Final = 24
"""Maximum number of pictures per visitor, so that some are left for others."""

START: Final[Message] = {
    "type": "http.response.start",
    "status": 200,
    "headers": [
        (b"content-type", f"multipart/x-mixed-replace; boundary={BOUNDARY}".encode()),
        (b"cache-control", b"no-store"),
        (b"x-accel-buffering", b"no"),
    ],
}


class MjpegStreams:
    """Streams a camera's overlay for as long as the browser takes it. An ASGI application.

    The route's parameters are robot, camera and stream. The overlay is looked at from the request to the end of the
    connection. A slow browser gets fewer frames, never older ones.
    """

    def __init__(self, pictures: Pictures, *, repeat_s: float = REPEAT_S, gone_s: float = GONE_S) -> None:
        self._pictures = pictures
        self._looks = Counter[str]()
        self._repeat_s = repeat_s
        self._gone_s = gone_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send frames until the browser disconnects or its user logs out."""
        visitor = visitor_of(Request(scope))
        async with AsyncExitStack() as stack:
            try:
                stack.enter_context(self._counted(visitor.name))
                newest = await stack.enter_async_context(self._pictures.hold(_overlay(**scope["path_params"])))
            except SchemaError as error:
                await PlainTextResponse(str(error), 404)(scope, receive, send)
                return
            except CrowdedError as error:
                await PlainTextResponse(str(error), 503)(scope, receive, send)
                return
            sending = asyncio.create_task(self._send_frames(newest, visitor, send))
            listening = asyncio.create_task(_until_disconnected(receive))
            try:
                await asyncio.wait((sending, listening), return_when=asyncio.FIRST_COMPLETED)
            finally:
                sending.cancel()
                listening.cancel()
                await asyncio.wait((sending, listening))
            if not sending.cancelled():
                sending.result()

    @contextmanager
    def _counted(self, name: str) -> Iterator[None]:
        if self._looks[name] >= MOST_OF_VISITOR:
            raise CrowdedError(f"you already have {MOST_OF_VISITOR} pictures open; close another view first")
        self._looks[name] += 1
        try:
            yield
        finally:
            self._looks[name] -= 1
            if not self._looks[name]:
                del self._looks[name]

    async def _send_frames(self, newest: Newest[ImageFrame], visitor: Visitor, send: Send) -> None:
        """Send until a part is not taken in time, or the visitor has lost permission."""
        parts = [START, _body(f"--{BOUNDARY}\r\n".encode() + _part("image/gif", NOTHING))]
        shown = 0
        with suppress(TimeoutError):
            while visitor.may_look:
                async with asyncio.timeout(self._gone_s):
                    for part in parts:
                        await send(part)
                shown = await self._next(newest, shown)
                parts = [_body(picture_part(newest.message))]

    async def _next(self, newest: Newest[ImageFrame], shown: int) -> int:
        """Wait for a newer frame, but not for longer than frames are repeated after; return which is the newest."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._repeat_s):
                await newest.after(shown)
        return newest.number


def path_of(key: StreamKey) -> str:
    """Return the URL path of an overlay; names of robots and cameras are safe in URLs."""
    return f"/pictures/{key.camera.robot}/{key.camera.camera}/{key.stream}"


def _overlay(robot: str, camera: str, stream: str) -> StreamKey:
    if stream not in OVERLAYS:
        raise SchemaError(f"{stream[:64]!r} is not a picture; use one of {', '.join(OVERLAYS)}")
    return StreamKey(CameraKey(robot, camera), Stream(stream))


def picture_part(frame: ImageFrame | None) -> bytes:
    """Return a frame as one part followed by the boundary, which makes browsers show the part at once."""
    kind = KINDS.get(frame.format) if frame else None
    return _part(kind, bytes(frame.data)) if frame and kind else _part("image/gif", NOTHING)


def _part(kind: str, data: bytes) -> bytes:
    return b"Content-Type: %b\r\nContent-Length: %d\r\n\r\n%b\r\n--%b\r\n" % (
        kind.encode(),
        len(data),
        data,
        BOUNDARY.encode(),
    )


def _body(data: bytes) -> Message:
    return {"type": "http.response.body", "body": data, "more_body": True}


async def _until_disconnected(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
