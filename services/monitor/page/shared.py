"""What all pages that are looked at have in common, so that it is made once for all of them."""

from collections.abc import Mapping

from services.monitor.monitor import Monitor
from services.monitor.page.health_rows import WorkerRates
from services.monitor.page.robots import Survey
from services.monitor.page.sightings import Stock


class Shared:
    """The newest survey and stock of a monitor, made of its newest picture and inventory.

    rates: frames a second of each worker, as of the newest survey.
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._survey: Survey | None = None
        self._stock: Stock | None = None
        self._rates = WorkerRates()
        self.rates: Mapping[str, float] = {}

    async def survey(self) -> Survey:
        """Return the robots as they are now."""
        picture = await self._monitor.picture()
        if self._survey is None or self._survey.picture is not picture:
            self._survey = Survey(picture)
            self.rates = self._rates.take(picture.workers)
        return self._survey

    async def stock(self) -> Stock:
        """Return what is or was in view, as it is now."""
        entries = await self._monitor.inventory()
        if self._stock is None or self._stock.entries is not entries:
            self._stock = Stock(entries)
        return self._stock
