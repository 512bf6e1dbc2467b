"""Messages of one stream that wait in order for the uplink's budget."""

from collections import deque
from collections.abc import Callable

from bus import SMALL_BYTES, SMALL_WAITING, Payload
from gateway.shaping.pacer import Pacer


class PacedQueue:
    """At most SMALL_WAITING messages wait, the newest ones; one of more than SMALL_BYTES waits for none older."""

    def __init__(self, pacer: Pacer, send: Callable[[Payload], None]) -> None:
        self._pacer = pacer
        self._send = send
        self._waiting: deque[Payload] = deque()

    def put(self, payload: Payload) -> int:
        """Send a message as soon as the budget allows; return how many older ones are lost by that."""
        room = SMALL_WAITING - 1 if len(payload) <= SMALL_BYTES else 0
        lost = max(0, len(self._waiting) - room)
        for _ in range(lost):
            self._waiting.popleft()
        self._waiting.append(payload)
        if lost or len(self._waiting) == 1:
            self._offer_first()
        return lost

    def flush(self) -> None:
        """Send at once what waits: nobody is reached by way of the link."""
        self._pacer.discard(self)
        while self._waiting:
            self._send(self._waiting.popleft())

    def close(self) -> int:
        """Send nothing more; return how many messages waited."""
        self._pacer.discard(self)
        left = len(self._waiting)
        self._waiting.clear()
        return left

    def _offer_first(self) -> None:
        """Let the oldest wait in the pacer, alone or in the place of one that was lost."""
        self._pacer.offer(self, self._waiting[0], self._send_first)

    def _send_first(self, payload: Payload) -> None:
        self._waiting.popleft()
        self._send(payload)
        if self._waiting:
            self._offer_first()
