"""The links of a session as they come and go: counted, named by certificates, and told of in the log."""

import logging
import time
from collections.abc import Collection
from typing import Final

from bus.session.link_names import LinkNames
from bus.session.link_use import LinkUse, LinkWarning
from bus.session.links import Links
from bus.settings import BusSettings

_log: Final = logging.getLogger(__name__)


class SessionLinks:
    """The links of a session; true while one to a configured endpoint is up. most: how many it takes."""

    def __init__(self, settings: BusSettings, most: int) -> None:
        self._links = Links(settings)
        self._names = LinkNames()
        self._warning = LinkWarning()
        self._most = most

    def __bool__(self) -> bool:
        return bool(self._links)

    @property
    def use(self) -> LinkUse:
        """See `bus.api.Bus.links`."""
        names, now_s = self._names, time.monotonic()
        strangers, copied = len(names.strangers()), len(names.copied(now_s))
        return LinkUse(self._links.count, self._most, strangers, copied, tuple(names.problems(now_s)))

    def begin(self, known: Collection[str] | None) -> None:
        """Forget the links of the session before. known: the names in this one's access rules; None without rules."""
        self.clear()
        self._names.known = known

    def clear(self) -> None:
        """Forget all links."""
        self._links.clear()
        self._names.clear()

    def add(self, own: str, other: str, name: str) -> bool:
        """Add a link; return whether it leads to a configured endpoint. name: in the other end's certificate."""
        if self._names.add(own, other, name, time.monotonic()):
            _log.warning("certificate %s connects from %s, and the access rules allow it nothing", name, other)
        sought = self._links.add(own, other)
        if sought:
            _log.info("connected to %s", other)
        if news := self._warning.news(self.use):
            _log.warning("%s", news)
        return sought

    def remove(self, own: str, other: str) -> bool:
        """Remove a link; return whether it led to a configured endpoint."""
        self._names.remove(own, other)
        return self._links.remove(own, other)

    def missing(self) -> list[str]:
        """Return the endpoints that want a link, see `Links.missing`."""
        return self._links.missing()
