"""One Zenoh key on its way to one ROS topic: checks, translation and the account of every message. Pure."""

import logging
from collections import Counter
from typing import Final, Generic

from gateway.outgoing.translators import R, Translator
from gateway.ros1.errors import MessageError
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.keys import CameraKey
from schemas.status import ReturnStatus

log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"
DOUBLED: Final = "of a frame returned already, or older"
REPLACED: Final = "replaced by a newer one before the gateway took it"
SLOW: Final = "replaced by a newer one before a slow ROS subscriber took it"


class StreamReturn(Generic[R]):
    """Turns a stream's results into ROS messages; frames only go forward.

    root: the camera's result namespace on ROS.
    """

    def __init__(self, camera: CameraKey, root: str, translator: Translator[R]) -> None:
        self.camera = camera
        self.translator = translator
        self.topic = f"{root}/{translator.topic}"
        self._last: Header | None = None
        self._received = 0
        self._published = 0
        self._dropped: Counter[str] = Counter()

    @property
    def key(self) -> str:
        """The key that results come under."""
        return self.camera.stream(self.translator.stream)

    def take(self, payload: bytes, encoding: str, replaced: int) -> bytes | None:
        """Return the ROS message of a result, or None when it is malformed or doubled, which is counted.

        replaced: how many results a newer one replaced since the last one taken.
        """
        self._received += 1 + replaced
        self._dropped[REPLACED] += replaced
        try:
            result = codec.decode(self.translator.schema, payload, encoding)
            codec.check_identity(result.header, self.camera)
            if not self._is_new(result.header):
                self._dropped[DOUBLED] += 1
                return None
            message = self.translator.translate(result)
        except (MessageError, SchemaError) as error:
            self._dropped[MALFORMED] += 1
            log.warning("%s: result left out: %s", self.key, error)
            return None
        self._last = result.header
        self._published += 1
        return message

    def status(self, *, wanted: bool, subscribers: int, slow: int) -> ReturnStatus:
        """Account for every message; `slow` is how many were replaced while they waited for a ROS subscriber."""
        return ReturnStatus(
            camera=self.camera.camera,
            stream=self.translator.stream,
            topic=self.topic,
            wanted=wanted,
            subscribers=subscribers,
            received=self._received,
            published=self._published,
            dropped=dict(self._dropped + Counter({SLOW: slow})),
        )

    def _is_new(self, header: Header) -> bool:
        last = self._last
        return last is None or header.boot_id != last.boot_id or header.seq > last.seq
