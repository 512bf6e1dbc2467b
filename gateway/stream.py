"""One ROS topic on its way to one Zenoh key: numbering, translation and the account of every message. Pure."""

import logging
from collections import Counter
from collections.abc import Mapping
from typing import Final

from gateway.ros1.errors import MessageError
from gateway.translators import Bytes, Translator
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.keys import CameraKey, Stream
from schemas.status import REPLACED_BEFORE_LINK, StreamStatus

log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"


class StreamForward:
    """Turns a topic's messages into payloads.

    boot_id: this gateway process. Numbers count on while nobody listens and the topic is not subscribed.
    """

    def __init__(self, camera: CameraKey, stream: Stream, topic: str, translator: Translator, boot_id: str) -> None:
        self.camera = camera
        self.stream = stream
        self.topic = topic
        self.translator = translator
        self._boot_id = boot_id
        self._received = 0
        self._translated = 0
        self._dropped: Counter[str] = Counter()

    @property
    def key(self) -> str:
        """The key that payloads are to be published under."""
        return self.camera.stream(self.stream)

    def take(self, message: Bytes, sender: str, now_ns: int) -> bytes | None:
        """Return the payload of a serialised ROS message, or None when it is malformed, which is counted.

        now_ns: when the whole message was here, nanoseconds since the epoch. sender: who published it, for the log.
        """
        self._received += 1
        header = Header(
            robot=self.camera.robot,
            camera=self.camera.camera,
            boot_id=self._boot_id,
            seq=self._translated,
            stamp_ns=0,
            frame_id="",
            received_ns=now_ns,
        )
        try:
            payload = self.translator.translate(message, header)
        except (MessageError, SchemaError) as error:
            self._dropped[MALFORMED] += 1
            log.warning("%s from %s: message left out: %s", self.topic, sender, error)
            return None
        self._translated += 1
        return payload

    def status(self, *, wanted: bool, publishers: int, replaced: int, broken_links: Mapping[str, int]) -> StreamStatus:
        """Account for every message; `replaced` is how many payloads a newer one replaced before the link."""
        dropped = self._dropped + Counter({REPLACED_BEFORE_LINK: replaced})
        return StreamStatus(
            camera=self.camera.camera,
            stream=self.stream,
            topic=self.topic,
            wanted=wanted,
            publishers=publishers,
            received=self._received,
            forwarded=self._translated - replaced,
            dropped=dict(dropped),
            broken_links=dict(broken_links),
        )
