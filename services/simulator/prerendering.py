"""Everything that a fleet's sensors will measure, made before it starts."""

import asyncio
import logging
from collections.abc import Iterable
from concurrent.futures import Executor

from services.simulator.bars import bar
from services.simulator.robot import Robot

log = logging.getLogger(__name__)


async def prerender(fleet: Iterable[Robot], executor: Executor) -> list[Robot]:
    """Make the robots and measure all that their topics need; `executor` does it, while progress is shown."""
    loop = asyncio.get_running_loop()
    robots = await loop.run_in_executor(executor, list, fleet)
    films = {robot.film: robot.parts for robot in robots}
    with bar("rendering", sum(film.frames for film in films)) as done:
        for film, parts in films.items():
            for number in range(film.frames):
                await loop.run_in_executor(executor, film.measure, number, parts)
                done()
    stores = {film.store for film in films}
    log.info("keeps %.0f MiB", sum(store.size for store in stores) / 2**20)
    if any(store.refused for store in stores):
        log.warning("not everything fits in --memory-mib: what does not is rendered again each time")
    return robots
