"""The certificates' names by which links are known, and what is wrong with them. Pure: time is an argument.

Zenoh (1.10) refuses silently what access rules do not allow. Names of links are what it tells.
"""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from bus.session.links import host_of, is_loopback

AT_ONCE_S: Final = 10.0
"""Time for which a name is used at two addresses until that is a problem: a robot that roams leaves a link behind."""

MOST_NAMED: Final = 3

Link = tuple[str, str]
"""Its local and its remote end."""


class LinkNames:
    """The links of a process by the name in the certificate of their other end. Links without certificates have none.

    known: the names in the access rules; None without rules. of_one_machine: those that are used at one address each;
    workers may share a certificate.
    """

    def __init__(self) -> None:
        self.known: Collection[str] | None = None
        self.of_one_machine: Collection[str] = ()
        self._links: dict[Link, str] = {}
        self._hosts: dict[str, Counter[str]] = {}
        self._strangers: set[str] = set()
        self._apart_since_s: dict[str, float] = {}

    def clear(self) -> None:
        """Forget all links."""
        for each in (self._links, self._hosts, self._strangers, self._apart_since_s):
            each.clear()

    def add(self, own: str, other: str, name: str, now_s: float) -> bool:
        """Add a link; return whether it is the first one of a name that is in no rule."""
        if not name or (own, other) in self._links:
            return False
        self._links[own, other] = name
        hosts = self._hosts.setdefault(name, Counter())
        hosts[_host(other)] += 1
        if len(hosts) > 1 and name in self.of_one_machine:
            self._apart_since_s.setdefault(name, now_s)
        is_news = self.known is not None and name not in self.known and name not in self._strangers
        if is_news:
            self._strangers.add(name)
        return is_news

    def remove(self, own: str, other: str) -> None:
        """Remove a link."""
        name = self._links.pop((own, other), "")
        if not name:
            return
        hosts, host = self._hosts[name], _host(other)
        hosts[host] -= 1
        if not hosts[host]:
            del hosts[host]
        if len(hosts) < 2:
            self._apart_since_s.pop(name, None)
        if not hosts:
            del self._hosts[name]
            self._strangers.discard(name)

    def seen(self) -> "SeenNames":
        """Return what is wrong with names now, for other threads."""
        apart = tuple(
            (name, tuple(sorted(self._hosts[name])), since_s) for name, since_s in sorted(self._apart_since_s.items())
        )
        return SeenNames(tuple(sorted(self._strangers)), apart)


@dataclass(frozen=True, slots=True)
class SeenNames:
    """Problems with the names of links at one moment.

    strangers: names in no rule: all that they send is refused. apart: names of one machine that are used at several
    addresses, these, and since when.
    """

    strangers: tuple[str, ...] = ()
    apart: tuple[tuple[str, tuple[str, ...], float], ...] = ()

    def copied(self, now_s: float) -> list[str]:
        """Return the names that have been used at several addresses for a while."""
        return [name for name, _, since_s in self.apart if now_s - since_s >= AT_ONCE_S]

    def problems(self, now_s: float) -> list[str]:
        """Return a line about each of the first names that something is wrong with."""
        strangers = [
            f"certificate {name} connects, and the access rules let nobody of that name do anything: it is revoked,"
            " denied, or missing in fleet.yaml"
            for name in self.strangers
        ]
        copied = [
            f"certificate {name} is used at {' and '.join(hosts)} at once: if these are two machines, it was copied;"
            f" `fleetsight pki revoke {name}` and issue another name"
            for name, hosts, since_s in self.apart
            if now_s - since_s >= AT_ONCE_S
        ]
        return [*strangers[:MOST_NAMED], *copied[:MOST_NAMED]]


def _host(end: str) -> str:
    """Return the host of a link's end; this machine is one, whatever it is called."""
    return "this machine" if is_loopback(end) else host_of(end)
