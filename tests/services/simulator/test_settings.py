import pytest
from pydantic import ValidationError

from services.simulator.localisation import Lost
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import SimulatedStream


@pytest.fixture(autouse=True)
def _no_master_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_MASTER_URI", raising=False)


def test_a_robots_camera_is_what_the_shipped_model_was_trained_on() -> None:
    settings = SimulatorSettings()
    assert (settings.width, settings.height, settings.ros_master) == (640, 480, None)


def test_ros_own_variable_names_a_real_master(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://robot:11399/")
    assert SimulatorSettings().ros_master == "http://robot:11399"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("streams", []),
        ("streams", ["nothing"]),
        ("depth_encoding", "8UC1"),
        ("seconds", 0),
        ("seconds", float("inf")),
        ("seconds", float("nan")),
        ("memory_mib", 0),
        ("warehouses", 0),
        ("width", 100_000),
        ("ros_master", "nonsense"),
        ("ros_host", "bad host"),
        ("robots", 0),
        ("hz", 0),
        ("hz", 1e-12),
        ("height", 1),
        ("seed", -1),
        ("floor_plan", "map.pgm"),
        ("drift_m", -0.1),
        ("drift_deg", float("nan")),
        ("drift_s", 0),
        ("lost", ["r1=80-60"]),
        ("lost_m", 0),
        ("changes_per_minute", -1),
        ("changes_per_minute", 1_000),
    ],
)
def test_what_is_wrong_is_named(field: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        SimulatorSettings.model_validate({field: value})
    assert caught.value.errors()[0]["loc"][0] == field


def test_a_robot_has_all_its_sensors_unless_told_otherwise() -> None:
    assert SimulatorSettings().streams == ["color", "depth", "points", "lidar"]
    assert SimulatorSettings.model_validate({"streams": ["depth"]}).streams == [SimulatedStream.DEPTH]


def test_a_world_that_changes_cannot_be_rendered_before() -> None:
    with pytest.raises(ValidationError, match=r"leave it out with --changes-per-minute"):
        SimulatorSettings(prerender=True, changes_per_minute=3)


def test_only_robots_that_are_there_can_be_lost() -> None:
    found = SimulatorSettings(robots=2, lost=["r2=60-80", "r1=5-6"], lost_m=2.0).times_lost
    assert found == [Lost("r2", 60.0, 80.0, 2.0), Lost("r1", 5.0, 6.0, 2.0)]
    with pytest.raises(ValidationError, match=r"--lost: there is no robot r3; with --robots 2 the last is r2"):
        SimulatorSettings(robots=2, lost=["r3=60-80"])
