import logging
from concurrent.futures import ThreadPoolExecutor

import pytest

from services.simulator.film import Film, Part, Store
from services.simulator.process import prerender
from services.simulator.robot import Robot
from services.simulator.topics import SimulatedStream, topics
from tests.services.simulator.small import ALIGNED, FRAMES, HZ, PLENTY

COLOR_AND_DEPTH = topics([SimulatedStream.COLOR, SimulatedStream.DEPTH], aligned=True)


def fleet(limit: int) -> list[Robot]:
    film = Film(1, ALIGNED, FRAMES, HZ, Store(limit))
    return [Robot(name, "", film, COLOR_AND_DEPTH, ahead) for ahead, name in enumerate(("r1", "r2"))]


async def test_all_that_topics_need_is_there_before_anybody_drives(capsys: pytest.CaptureFixture[str]) -> None:
    robots = fleet(PLENTY)
    with ThreadPoolExecutor(1) as executor:
        assert await prerender(iter(robots), executor) == robots
    store = robots[0].film.store
    for number in range(FRAMES):
        assert store.get((1, number, Part.COLOR)) is not None
        assert store.get((1, number, Part.DEPTH)) is not None
        assert store.get((1, number, Part.SWEEP)) is None
    said = capsys.readouterr()
    assert f"rendering: {FRAMES} of {FRAMES}" in said.err
    assert said.out == ""


async def test_what_does_not_fit_is_said(caplog: pytest.LogCaptureFixture) -> None:
    with ThreadPoolExecutor(1) as executor, caplog.at_level(logging.INFO):
        await prerender(fleet(20_000), executor)
    assert "--memory-mib: not everything fits" in caplog.text
