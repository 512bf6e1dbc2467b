from math import inf, nan

from services.monitor.history.presence import KnownPoses
from services.monitor.map.last_seen import SightingMap
from services.monitor.map.pose import Pose

HERE, THERE = Pose(1.0, 2.0, 0.5, 7), Pose(3.0, 2.0, 0.5, 8)


def test_what_is_new_is_to_be_written_once() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": HERE, "r2": HERE})
    assert dict(poses.pending()) == {"r1": HERE, "r2": HERE}
    poses.written({"r1": HERE})
    assert dict(poses.pending()) == {"r2": HERE}
    poses.written({"r2": HERE})
    places.stand({"r1": THERE})
    assert dict(poses.pending()) == {"r1": THERE}


def test_what_a_store_kept_is_on_the_map_and_not_written_again() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": THERE})
    poses.restore({"r1": HERE, "r2": HERE})
    assert places.poses == {"r1": THERE, "r2": HERE}
    assert dict(poses.pending()) == {"r1": THERE}


def test_what_no_database_takes_is_not_written() -> None:
    places = SightingMap()
    poses = KnownPoses(places)
    places.stand({"r1": Pose(nan, 0, 0, 1), "r2": Pose(0, inf, 0, 1), "r3": Pose(0, 0, -nan, 1)})
    assert dict(poses.pending()) == {}
