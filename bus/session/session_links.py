"""The links of a session as they come and go: counted, named by certificates, and told of in the log."""

import logging
import time
from collections.abc import Mapping
from typing import Any, Final

from bus.session.access import names_in, of_one_machine
from bus.session.link_names import LinkNames, SeenNames
from bus.session.link_use import LinkUse, LinkWarning
from bus.session.links import Links
from bus.settings import BusSettings

_log: Final = logging.getLogger(__name__)


class SessionLinks:
    """The links of a session; true while one to a configured endpoint is up. most: how many it takes.

    Changed by the session's thread alone; `use` and truth may be asked for by others.
    """

    def __init__(self, settings: BusSettings, most: int) -> None:
        self._links = Links(settings)
        self._names = LinkNames()
        self._seen = SeenNames()
        self._warning = LinkWarning()
        self._most = most

    def __bool__(self) -> bool:
        return bool(self._links)

    @property
    def use(self) -> LinkUse:
        """See `bus.api.Bus.links`."""
        seen, now_s = self._seen, time.monotonic()
        copied, problems = len(seen.copied(now_s)), tuple(seen.problems(now_s))
        return LinkUse(self._links.count, self._most, len(seen.strangers), copied, problems)

    def begin(self, access: Mapping[str, Any] | None) -> None:
        """Forget the links of the session before. access: the rules of this one, if there are any."""
        self.clear()
        self._names.known = None if access is None else names_in(access)
        self._names.of_one_machine = () if access is None else of_one_machine(access)

    def clear(self) -> None:
        """Forget all links."""
        self._links.clear()
        self._names.clear()
        self._seen = self._names.seen()

    def add(self, own: str, other: str, name: str) -> bool:
        """Add a link; return whether it leads to a configured endpoint. name: in the other end's certificate."""
        if self._names.add(own, other, name, time.monotonic()):
            _log.warning("certificate %s connects from %s, and the access rules allow it nothing", name, other)
        self._seen = self._names.seen()
        sought = self._links.add(own, other)
        if sought:
            _log.info("connected to %s", other)
        if news := self._warning.news(self.use):
            _log.warning("%s", news)
        return sought

    def remove(self, own: str, other: str) -> bool:
        """Remove a link; return whether it led to a configured endpoint."""
        self._names.remove(own, other)
        self._seen = self._names.seen()
        return self._links.remove(own, other)

    def missing(self) -> list[str]:
        """Return the endpoints that want a link, see `Links.missing`."""
        return self._links.missing()
