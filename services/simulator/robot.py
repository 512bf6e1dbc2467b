"""A robot that is not there: a ROS 1 node that publishes its camera."""

import asyncio
import time
from concurrent.futures import Executor
from typing import Final

from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from services.simulator.film import Film

TOPIC: Final = "camera/color/image_raw"
FRAME_ID: Final = "camera_color_optical_frame"


class Robot:
    """Publishes a film on a topic at a rate. `executor` renders, off the event loop.

    sent: images handed to subscribers so far.
    """

    def __init__(self, name: str, topic: str, film: Film, hz: float) -> None:
        self.name = name
        self.sent = 0
        self._topic = topic
        self._film = film
        self._period_s = 1 / hz

    async def run(self, node: Node, executor: Executor) -> None:
        """Drive for ever. Pictures are rendered and sent only while somebody subscribes."""
        loop = asyncio.get_running_loop()
        async with node.advertise(self._topic, TYPE_NAME) as publication:
            begun_s = loop.time()
            number = 0
            try:
                while True:
                    if publication.subscriber_count:
                        picture = await loop.run_in_executor(executor, self._message, number)
                        publication.publish(picture)
                        self.sent = publication.counters.sent
                    number = max(number + 1, round((loop.time() - begun_s) / self._period_s))
                    await asyncio.sleep(begun_s + number * self._period_s - loop.time())
            finally:
                self.sent = publication.counters.sent

    def _message(self, number: int) -> bytes:
        picture = self._film.picture(number)
        height, width, channels = picture.shape
        stamp_s, stamp_ns = divmod(time.time_ns(), 1_000_000_000)
        return encode_image(
            Image(
                seq=number,
                stamp_s=stamp_s,
                stamp_ns=stamp_ns,
                frame_id=FRAME_ID,
                height=height,
                width=width,
                encoding="rgb8",
                is_bigendian=False,
                step=width * channels,
                data=picture.data.cast("B"),
            )
        )
