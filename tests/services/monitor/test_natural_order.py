from schemas.keys import CameraKey
from services.monitor.fleet import Fleet
from services.monitor.formats import cameras_in_order, natural, problem_lines


def test_names_are_sorted_as_people_count() -> None:
    assert sorted(["r10", "R2", "r1", "", "forklift-7", "r2a"], key=natural) == [
        "",
        "forklift-7",
        "r1",
        "R2",
        "r2a",
        "r10",
    ]


def test_cameras_are_sorted_by_robot_and_then_by_their_own_names() -> None:
    keys = [CameraKey(*name.split("/")) for name in ("r10/front", "r2/cam10", "r2/cam9", "r1/rear")]
    assert list(map(str, cameras_in_order(keys))) == ["r1/rear", "r2/cam9", "r2/cam10", "r10/front"]


def test_a_terminal_has_them_in_that_order() -> None:
    fleet = Fleet("clock")
    for name in ("r10", "r2", "r1"):
        fleet.robot_presence(name, alive=True)
        fleet.camera_presence(CameraKey(name, "front"), alive=True)
    assert [row.key.robot for row in fleet.rows(1.0)] == ["r1", "r2", "r10"]
    assert [row.key.robot for row in fleet.take_changed(1.0)] == ["r1", "r2", "r10"]
    assert problem_lines({"r10": ["waits"], "r2": ["waits"]}) == ["r2 waits", "r10 waits"]
