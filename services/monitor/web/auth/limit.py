"""How often somebody may try to log in in vain. Pure: time is an argument."""

import ipaddress
from collections import OrderedDict, deque
from typing import Final

WINDOW_S: Final = 900.0
MAX_OF_NAME: Final = 5
"""Failures of one name from one address."""

MAX_OF_ADDRESS: Final = 30
"""Failures of all names from one address."""

MAX_KEYS: Final = 10_000
MAX_NAME: Final = 64
"""Characters of a name that are remembered: it is anybody's."""


class FailureLimit:
    """Counts failures by address, and by address and name; nobody can lock somebody out who is elsewhere."""

    def __init__(self) -> None:
        self._failures: OrderedDict[tuple[str, ...], deque[float]] = OrderedDict()

    def wait_s(self, address: str, name: str, now_s: float) -> float:
        """Return how long it takes until the next try is allowed; 0 when it is."""
        every, own = _keys(address, name)
        return max(self._wait_s(every, MAX_OF_ADDRESS, now_s), self._wait_s(own, MAX_OF_NAME, now_s))

    def failed(self, address: str, name: str, now_s: float) -> None:
        """Count a failure; to be called before the password is looked at, so that many at once count too."""
        for key, most in zip(_keys(address, name), (MAX_OF_ADDRESS, MAX_OF_NAME), strict=True):
            self._failures.setdefault(key, deque(maxlen=most)).append(now_s)
            self._failures.move_to_end(key)
        while len(self._failures) > MAX_KEYS:
            self._failures.popitem(last=False)

    def succeeded(self, address: str, name: str) -> None:
        """Take back what was counted before a password that turned out right."""
        self.unknown(address, name)
        self._failures.pop(_keys(address, name)[1], None)

    def unknown(self, address: str, name: str) -> None:
        """Take back one that was counted before a password that nobody had the time to look at."""
        for key in _keys(address, name):
            if times := self._failures.get(key):
                times.pop()

    def _wait_s(self, key: tuple[str, ...], most: int, now_s: float) -> float:
        times = self._failures.get(key)
        return max(0.0, times[0] + WINDOW_S - now_s) if times and len(times) >= most else 0.0


def _keys(address: str, name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    of = network_of(address)
    return (of,), (of, name[:MAX_NAME])


def network_of(address: str) -> str:
    """Return whom an address counts for: itself, or of IPv6 the network that one subscriber has."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    if found.version == 6 and found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(found) if found.version == 4 else str(ipaddress.ip_network(f"{found}/64", strict=False))
