from services.monitor.fleet import Fleet
from services.monitor.picture import SILENT_NS, Painting, Picture
from tests.services.monitor.web.api.seeing import ODD, fill


def picture(fleet: Fleet, now_ns: int) -> Picture:
    painting = Painting(fleet, now_ns, 0.0)
    for _ in painting.steps():
        pass
    return painting.picture()


def test_an_empty_fleet_is_an_empty_picture() -> None:
    assert picture(Fleet("clock"), 5) == Picture(5, (), (), ())


def test_who_serves_and_what_was_dropped_is_with_the_camera_and_its_robot() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    heard_ns = fleet.heard_ns["r1"]
    now = picture(fleet, heard_ns)
    (first, lost), (camera, _), (worker,) = now.robots, now.cameras, now.workers
    assert camera.dropped == {f"gateway: {ODD}": 4, "detector/w1: late": 2}
    assert first.dropped == {**camera.dropped, "gateway: w": 1}
    assert (camera.served_by, worker.online, len(worker.serves)) == (("detector/w1",), True, 1)
    assert (first.online, first.last_ns >= heard_ns, lost.online, lost.last_ns, lost.gateway) == (
        True,
        True,
        False,
        0,
        None,
    )


def test_a_worker_that_says_nothing_serves_nobody() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    heard_ns = fleet.worker_heard_ns["detector", "w1"]
    assert picture(fleet, heard_ns + SILENT_NS).workers[0].online
    later = picture(fleet, heard_ns + SILENT_NS + 1)
    assert (later.workers[0].online, later.workers[0].serves, later.cameras[0].served_by) == (False, (), ())
