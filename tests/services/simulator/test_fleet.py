from services.simulator.fleet import robots
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import Stream

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
    changed = {"robots": 1, "align_depth": False, "depth_encoding": "32FC1", "streams": [Stream.DEPTH]}
    (robot,) = robots(SMALL.model_copy(update=changed), namespaced=False)
    equipment = robot.film.equipment
    assert (equipment.aligned, equipment.metric) == (False, True)
    assert (equipment.depth_camera.width, equipment.depth_camera.height) == (80, 40)
    assert equipment.depth_camera.fx < equipment.color.fx * 80 / 64
    assert "camera/depth/image_rect_raw" in {topic.name for topic in robot.topics}
    (aligned,) = robots(SMALL.model_copy(update={"robots": 1}), namespaced=False)
    assert aligned.film.equipment.depth_camera == aligned.film.equipment.color
