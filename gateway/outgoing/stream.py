"""One Zenoh key on its way to ROS: checks, and the account of every message."""

import logging
from collections import Counter
from collections.abc import Mapping
from typing import Final, Generic

from gateway.outgoing.novelty import Novelty
from gateway.outgoing.translator import R, Translator
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.keys import RobotStreamKey, StreamKey, owner_of
from schemas.status import ReturnStatus

log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"
DOUBLED: Final = "returned already, or of an older frame"
REFUSED: Final = "not allowed by the gateway's settings"
UNHEARD: Final = "nobody on ROS subscribed to its topic"
REPLACED: Final = "replaced by a newer one before the gateway took it"
SLOW: Final = "replaced by a newer one before a slow ROS subscriber took it"


class StreamReturn(Generic[R]):
    """Decides about a stream's results. For each one received: `returned`, `leave_out` or `unheard`, before the next.

    topics: by route (see Translator) where results go on ROS; those of another route are refused.
    """

    def __init__(
        self, key: StreamKey | RobotStreamKey, translator: Translator[R], novelty: Novelty[R], topics: Mapping[str, str]
    ) -> None:
        self.key = key
        self.translator = translator
        self.topics = topics
        self._novelty = novelty
        self._received = 0
        self._published = 0
        self._dropped: Counter[str] = Counter()

    def receive(self, payload: bytes, encoding: str, replaced: int) -> R | None:
        """Return a result that is to be returned, or None when it is malformed, doubled or refused, which is counted.

        replaced: how many results newer ones replaced since the last one taken.
        """
        self._received += 1 + replaced
        self._dropped[REPLACED] += replaced
        try:
            result = codec.decode(self.translator.schema, payload, encoding)
            new = self._novelty.is_new(result)
        except SchemaError as error:
            self.leave_out(error)
            return None
        if not new:
            self._dropped[DOUBLED] += 1
        elif (route := self.translator.route(result)) not in self.topics:
            self._dropped[REFUSED] += 1
            log.warning(
                "%s: %r refused: the gateway's settings do not allow it; --actions NAME=TOPIC would", self.key, route
            )
        else:
            return result
        return None

    def topic_of(self, result: R) -> str:
        """Return where a result goes."""
        return self.topics[self.translator.route(result)]

    @property
    def next_number(self) -> int:
        """The number of the message that is returned next."""
        return self._published + 1

    def returned(self, result: R) -> None:
        """Take note that a result was returned."""
        self._novelty.remember(result)
        self._published += 1

    def leave_out(self, error: Exception) -> None:
        """Take note that a result cannot be returned."""
        self._dropped[MALFORMED] += 1
        log.warning("%s: result left out: %s", self.key, error)

    def unheard(self, result: R) -> None:
        """Take note that nobody was there to take a result."""
        self._dropped[UNHEARD] += 1
        log.warning("%s: nobody subscribes to %s", self.key, self.topic_of(result))

    def retire(self, *, slow: int) -> None:
        """Remember what has been counted (see `status`) by publications that end: the stream counts on."""
        self._dropped[SLOW] += slow

    def status(self, *, wanted: bool, subscribers: int, slow: int) -> ReturnStatus:
        """Account for every message.

        slow: how many were replaced while they waited for a ROS subscriber; what was told to `retire` is added.
        """
        return ReturnStatus(
            camera=owner_of(self.key)[1],
            stream=self.key.stream,
            topic=", ".join(self.topics.values())[:MAX_LABEL],
            wanted=wanted,
            subscribers=subscribers,
            received=self._received,
            published=self._published,
            dropped=dict(self._dropped + Counter({SLOW: slow})),
        )
