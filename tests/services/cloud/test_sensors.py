from schemas.keys import CameraKey, Stream, StreamKey
from services.cloud.process import Sensors

FRONT, REAR, LIDAR, OTHER = (CameraKey("r1", name) for name in ("front", "rear", "lidar", "zebra"))


def there(sensors: Sensors, stream: Stream, *cameras: CameraKey, alive: bool = True) -> None:
    for camera in cameras:
        sensors.note(StreamKey(camera, stream), alive=alive)


def test_a_cameras_own_points_come_first_then_those_of_the_robots_first_lidar() -> None:
    sensors = Sensors({})
    assert sensors.points_of(FRONT) is None
    there(sensors, Stream.COLOR, FRONT, REAR)
    there(sensors, Stream.POINTS, CameraKey("r2", "lidar"), REAR)
    assert sensors.points_of(FRONT) is None
    there(sensors, Stream.POINTS, OTHER, LIDAR)
    assert (sensors.points_of(FRONT), sensors.points_of(REAR)) == (LIDAR, REAR)
    there(sensors, Stream.POINTS, FRONT)
    assert sensors.points_of(FRONT) == FRONT
    there(sensors, Stream.POINTS, FRONT, LIDAR, alive=False)
    assert sensors.points_of(FRONT) == OTHER


def test_what_the_settings_choose_is_taken_or_nothing() -> None:
    sensors = Sensors({"front": "zebra"})
    there(sensors, Stream.POINTS, FRONT, LIDAR)
    assert sensors.points_of(FRONT) is None
    there(sensors, Stream.POINTS, OTHER)
    assert sensors.points_of(FRONT) == OTHER
