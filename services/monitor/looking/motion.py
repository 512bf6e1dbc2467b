"""A moving picture for a browser's `<img>`: multipart/x-mixed-replace, each part the newest frame there is."""

import asyncio
from contextlib import AsyncExitStack, suppress
from typing import Final

from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from schemas.compression import JPEG, PNG
from schemas.image import ImageFrame
from schemas.keys import StreamKey
from services.monitor.looking.newest import Newest, Pictures
from services.monitor.looking.shared import CrowdedError

BOUNDARY: Final = "frame"
KINDS: Final = {JPEG: "image/jpeg", PNG: "image/png"}

NOTHING: Final = (
    b"GIF89a\x01\x00\x01\x00\x80\x00\x00\x00\x00\x00\xff\xff\xff!\xf9\x04\x01\x00\x00\x00\x00"
    b",\x00\x00\x00\x00\x01\x00\x01\x00\x00\x02\x02D\x01\x00;"
)
"""A transparent pixel, until the first frame comes."""

REPEAT_S: Final = 5.0
"""With nothing new the last frame is sent again after this: of a browser that vanished nothing else tells."""

GONE_S: Final = 10.0
"""Who takes nothing of what is sent for so long has gone."""

START: Final[Message] = {
    "type": "http.response.start",
    "status": 200,
    "headers": [
        (b"content-type", f"multipart/x-mixed-replace; boundary={BOUNDARY}".encode()),
        (b"cache-control", b"no-store"),
        (b"x-accel-buffering", b"no"),
    ],
}


class MotionPicture:
    """Answers a request with a camera's overlay, for as long as the browser takes it. An ASGI application.

    The overlay is looked at from the request to the end of the connection. A slow browser gets fewer frames, never
    older ones.
    """

    def __init__(
        self, pictures: Pictures, key: StreamKey, *, repeat_s: float = REPEAT_S, gone_s: float = GONE_S
    ) -> None:
        self._pictures = pictures
        self._key = key
        self._repeat_s = repeat_s
        self._gone_s = gone_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send frames until the browser is gone."""
        async with AsyncExitStack() as stack:
            try:
                newest = await stack.enter_async_context(self._pictures.hold(self._key))
            except CrowdedError as error:
                await PlainTextResponse(str(error), 503)(scope, receive, send)
                return
            async with asyncio.TaskGroup() as group:
                sending = group.create_task(self._send_frames(newest, send))
                listening = group.create_task(_until_disconnected(receive))
                await asyncio.wait((sending, listening), return_when=asyncio.FIRST_COMPLETED)
                sending.cancel()
                listening.cancel()

    async def _send_frames(self, newest: Newest[ImageFrame], send: Send) -> None:
        """Send until a part is not taken in time."""
        parts = [START, _body(f"--{BOUNDARY}\r\n".encode() + _part("image/gif", NOTHING))]
        shown = 0
        with suppress(TimeoutError):
            while True:
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


def picture_part(frame: ImageFrame | None) -> bytes:
    """Return a frame as one part and the boundary after it, which makes browsers show the part at once."""
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
