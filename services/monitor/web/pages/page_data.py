"""Data shared by all visible pages, made once for all of them."""

from collections.abc import Mapping
from typing import Final

from services.monitor.event_loop.cached_value import CachedValue
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.monitor import Monitor
from services.monitor.web.pages.rows.health import WorkerRates
from services.monitor.web.pages.rows.robots import Survey, robot_summaries
from services.monitor.web.pages.rows.sightings import SightingTable

MAX_AGE_S: Final = 1.9
"""Maximum age of the survey of robots, and of the sightings, in seconds."""

SHARE: Final = 0.05
"""Maximum share of time spent on making them: in a small fleet they are made on each request."""


class PageData:
    """The newest survey and sightings of a monitor.

    rates: frames a second of each worker, as of the newest survey.
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._survey = CachedValue(self._take_survey, MAX_AGE_S, share=SHARE)
        self._sightings = CachedValue(self._take_sightings, MAX_AGE_S, share=SHARE)
        self._rates = WorkerRates()
        self.rates: Mapping[str, float] = {}

    async def survey(self) -> Survey:
        """Return the current robots."""
        return await self._survey.get()

    async def sightings(self) -> SightingTable:
        """Return the current sightings."""
        return await self._sightings.get()

    async def _take_survey(self) -> Survey:
        fleet_view = self._monitor.fleet_view()
        self.rates = self._rates.take(fleet_view.workers.lines)
        return Survey(fleet_view, [each async for each in in_turns(robot_summaries(fleet_view))])

    async def _take_sightings(self) -> SightingTable:
        return SightingTable(await self._monitor.inventory())
