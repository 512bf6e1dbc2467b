"""The newest report of each warehouse, at a centre. Pure: time is an argument."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from schemas.inventory import WarehouseReport
from services.monitor.formats import natural
from services.monitor.status_bytes import StatusBytes

FRESH_NS: Final = 10_000_000_000
"""Age from which a report is no longer current: a warehouse sends one every two seconds."""

MAX_WAREHOUSES: Final = 1_000


@dataclass(frozen=True, slots=True)
class KnownWarehouse:
    """The last report of a warehouse, and when it came."""

    report: WarehouseReport
    received_ns: int

    @property
    def name(self) -> str:
        """Its name."""
        return self.report.warehouse

    @property
    def objects(self) -> Counter[str]:
        """The objects of its sites, each once, by class; those in view where no site is looked after."""
        current = [site.objects for site in self.report.sites if site.current]
        totals = Counter[str]()
        for objects in current or [self.report.in_view]:
            totals.update(objects)
        return totals

    def is_current(self, now_ns: int) -> bool:
        """Whether it reports."""
        return now_ns - self.received_ns <= FRESH_NS


class Warehouses:
    """The warehouses that ever reported since this monitor began, by name."""

    def __init__(self) -> None:
        self._known: dict[str, KnownWarehouse] = {}
        self._bytes = StatusBytes[str]()

    def __bool__(self) -> bool:
        """Whether there is one: this monitor is a centre."""
        return bool(self._known)

    def take(self, report: WarehouseReport, received_ns: int, size: int = 0) -> None:
        """Take a report of `size` bytes; of more than MAX_WAREHOUSES the one heard of longest ago is forgotten.

        Raises:
            SchemaError: there are too many bytes of reports already, see `StatusBytes`.
        """
        for each in self._bytes.take(report.warehouse, size):
            del self._known[each]
        self._known.pop(report.warehouse, None)
        self._known[report.warehouse] = KnownWarehouse(report, received_ns)
        if len(self._known) > MAX_WAREHOUSES:
            oldest = next(iter(self._known))
            self._bytes.drop(oldest)
            del self._known[oldest]

    def of(self, name: str) -> KnownWarehouse | None:
        """Return what is known of a warehouse, None if nothing is."""
        return self._known.get(name)

    def every(self) -> list[KnownWarehouse]:
        """Return all warehouses by name."""
        return [self._known[name] for name in sorted(self._known, key=natural)]

    def problems(self, now_ns: int) -> Iterator[str]:
        """Yield a line for each warehouse that reports no more."""
        for each in self.every():
            if not each.is_current(now_ns):
                silent_s = (now_ns - each.received_ns) // 1_000_000_000
                yield f"warehouse {each.name} has not reported for {silent_s} s: its monitor, or the link, is down"
