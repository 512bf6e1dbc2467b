from services.simulator.fleet import robots
from services.simulator.localisation import Drift, Localisation, Lost
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import SimulatedStream

SMALL = SimulatorSettings(robots=5, warehouses=2, width=64, height=48, depth_width=80, depth_height=40, seed=10)


def test_robots_are_spread_over_warehouses_and_follow_each_other_there() -> None:
    fleet = list(robots(SMALL, namespaced=False))
    assert [robot.name for robot in fleet] == ["r1", "r2", "r3", "r4", "r5"]
    assert [robot.film.seed for robot in fleet] == [11, 12, 11, 12, 11]
    assert [robot.ahead for robot in fleet] == [0, 0, 4, 4, 8]
    assert len({id(robot.film) for robot in fleet}) == 2
    assert len({id(robot.film.store) for robot in fleet}) == 1


def test_names_are_in_topics_where_robots_share_them() -> None:
    one = SMALL.model_copy(update={"robots": 1})
    for namespaced, path in ((False, "/tf_static"), (True, "/r1/tf_static")):
        (robot,) = robots(one, namespaced=namespaced)
        assert robot.path(robot.topics[0]) == path


def test_depth_is_as_the_settings_say() -> None:
    changed = {"robots": 1, "align_depth": False, "depth_encoding": "32FC1", "streams": [SimulatedStream.DEPTH]}
    (robot,) = robots(SMALL.model_copy(update=changed), namespaced=False)
    equipment = robot.film.equipment
    assert (equipment.aligned, equipment.metric) == (False, True)
    assert (equipment.depth_camera.width, equipment.depth_camera.height) == (80, 40)
    assert equipment.depth_camera.fx < equipment.color.fx * 80 / 64
    assert "camera/depth/image_rect_raw" in {topic.name for topic in robot.topics}
    (aligned,) = robots(SMALL.model_copy(update={"robots": 1}), namespaced=False)
    assert aligned.film.equipment.depth_camera == aligned.film.equipment.color


def test_each_robots_localisation_errs_on_its_own_where_that_is_asked_for() -> None:
    assert [robot.localisation for robot in robots(SMALL, namespaced=False)] == [None] * 5
    first, second, *_ = robots(SMALL.model_copy(update={"drift_m": 0.05, "drift_s": 20.0}), namespaced=False)
    assert first.localisation is not None
    assert second.localisation is not None
    assert first.localisation.error(3.0) == Localisation(Drift(0.05, 0.0, 20.0), (), (10, 0)).error(3.0)
    assert second.localisation.error(3.0) != first.localisation.error(3.0)
    lost = SMALL.model_copy(update={"lost": ["r2=5-6", "r2=8-9"], "lost_m": 2.0})
    first, second, *_ = robots(lost, namespaced=False)
    assert first.localisation is None
    assert second.localisation is not None
    times = [Lost("r2", 5.0, 6.0, 2.0), Lost("r2", 8.0, 9.0, 2.0)]
    for second_s in (5.5, 7.0, 8.5):
        assert second.localisation.error(second_s) == Localisation(Drift(), times, (10, 1)).error(second_s)
