"""What a world model goes on with after a restart, or where another worker takes its site over."""

import msgspec
import numpy as np
import pytest

from services.worldmodel.model import SiteModel
from services.worldmodel.offsets import ALONE_VIEWS_TO_TRUST, LOST, REASONS, RIGHT
from services.worldmodel.published_objects import PublishedObjects
from services.worldmodel.state import restored, saved
from tests.services.worldmodel.scene import KNOWN_S, TWO, Camera, doubted, knowing, known, look_on, without_depth


def after_restart(before: SiteModel) -> SiteModel:
    model = SiteModel()
    restored("hall", saved("hall", "a", 0, before), model)
    return model


def doubts(model: SiteModel) -> list[str]:
    return [each.doubted for each in PublishedObjects("hall", "a", model).robots()]


def test_a_robot_that_is_doubted_stays_so_after_a_restart() -> None:
    before = knowing(TWO)
    look_on(before, TWO, Camera(robot="r2", off=(0.0, 1.5, 0.0)), 3)
    model = after_restart(before)
    assert doubts(model) == [REASONS[LOST]]
    assert look_on(model, [], Camera(robot="r2"), 2 * ALONE_VIEWS_TO_TRUST, start_s=KNOWN_S + 2) == []
    assert (doubted(model, "r1"), doubted(model, "r2")) == (RIGHT, LOST)
    assert len(known(model)) == len(TWO)
    look_on(model, TWO, Camera(robot="r2"), 5, start_s=60.0)
    assert doubts(after_restart(model)) == []


@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_how_high_the_floor_is_stays_known_after_a_restart(robot: str) -> None:
    model = after_restart(knowing(TWO))
    assert look_on(after_restart(model), [], Camera(robot=robot), ALONE_VIEWS_TO_TRUST, drives=True) == ["gone"] * len(
        TWO
    )
    assert look_on(model, [], Camera(robot=robot), ALONE_VIEWS_TO_TRUST, without_depth) == []
    assert REASONS[doubted(model, robot)] == "its depth does not fit the floor"


def test_a_robot_that_was_known_before_a_restart_has_no_place_before_its_first_view() -> None:
    published = PublishedObjects("hall", "a", after_restart(knowing(TWO)))
    assert published.nearby("r1", 8.0, 0) == []
    look_on(published.model, TWO, Camera(), 1)
    assert len(published.nearby("r1", 8.0, 0)) == len(TWO)


def test_states_without_doubts_or_with_such_that_nobody_knows_are_taken() -> None:
    before = knowing(TWO)
    look_on(before, TWO, Camera(robot="r2", off=(0.0, 1.5, 0.0)), 3)
    fields = msgspec.msgpack.decode(saved("hall", "a", 0, before))
    additions: list[dict[str, object]] = [
        {"doubted": {"r2": 99}, "floors_m": [np.nan, np.inf, 0.0]},
        {"doubted": {}, "floors_m": []},
    ]
    for added in additions:
        model = SiteModel()
        restored("hall", msgspec.msgpack.encode(fields | added), model)
        assert doubts(model) == ([REASONS[LOST]] if added["doubted"] else [])
        assert np.isnan(model.offsets.floors.known).all()
    model = SiteModel()
    restored("hall", msgspec.msgpack.encode({name: fields[name] for name in fields if name not in added}), model)
    assert len(known(model)) == len(TWO)
