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


class FailureLimit:
    """Counts failures by address, and by address and name; nobody can lock somebody out who is elsewhere."""

    def __init__(self) -> None:
        self._failures: OrderedDict[tuple[str, ...], deque[float]] = OrderedDict()

    def wait_s(self, address: str, name: str, now_s: float) -> float:
        """Return how long it takes until the next try is allowed; 0 when it is."""
        of = network_of(address)
        return max(self._wait_s((of,), MAX_OF_ADDRESS, now_s), self._wait_s((of, name), MAX_OF_NAME, now_s))

    def failed(self, address: str, name: str, now_s: float) -> None:
        """Count a failure; to be called before the password is looked at, so that many at once count too."""
        of = network_of(address)
        for key, most in (((of,), MAX_OF_ADDRESS), ((of, name), MAX_OF_NAME)):
            self._failures.setdefault(key, deque(maxlen=most)).append(now_s)
            self._failures.move_to_end(key)
        while len(self._failures) > MAX_KEYS:
            self._failures.popitem(last=False)

    def succeeded(self, address: str, name: str) -> None:
        """Take back what was counted before a password that turned out right."""
        of = network_of(address)
        self._failures.pop((of, name), None)
        if times := self._failures.get((of,)):
            times.pop()

    def _wait_s(self, key: tuple[str, ...], most: int, now_s: float) -> float:
        times = self._failures.get(key)
        return max(0.0, times[0] + WINDOW_S - now_s) if times and len(times) >= most else 0.0


def network_of(address: str) -> str:
    """Return whom an address counts for: itself, or of IPv6 the network that one subscriber has."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    if found.version == 6 and found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(found) if found.version == 4 else str(ipaddress.ip_network(f"{found}/64", strict=False))
