from dataclasses import replace

import pytest

from schemas.keys import CameraKey, Stream
from schemas.status import CameraLoad, WorkerStatus
from services.monitor.live_views.why_no_picture import FIRST_FRAME_TIMEOUT_S, LATE, WAITING, Facts, serving, why_nothing

FRONT = CameraKey("r1", "front")
LOAD = CameraLoad(robot="r1", camera="front", inferred=1, serving=True)
WORKER = WorkerStatus(service="detector", worker="w1", model="m", sent_ns=1, cameras=[LOAD])
BOXES_ONLY = WorkerStatus(
    service="detector",
    worker="w1",
    model="m",
    sent_ns=1,
    remarks=["m.pt has no masks: overlay/segmentation, distances and objects are not published"],
)
MODELLESS = WorkerStatus(service="detector", worker="w2", model="", sent_ns=1, remarks=["no model is in force: ..."])
GOOD = Facts(known=True, robot_online=True, camera_online=True, serving=(WORKER,), workers=(WORKER,))


@pytest.mark.parametrize(
    ("facts", "title", "advice"),
    [
        (
            replace(GOOD, deaf="no link", robot_online=False),
            "This monitor has no link to the fleet",
            "no link. The state of r1 is unknown",
        ),
        (replace(GOOD, deaf="no link", known=False), "This monitor has no link to the fleet", "the router"),
        (replace(GOOD, known=False), "No camera r1/front", "--robot r1"),
        (replace(GOOD, robot_online=False), "r1 is offline", "switched on"),
        (replace(GOOD, camera_online=False), "front is not published on r1", "fleetsight doctor --robot r1"),
        (replace(GOOD, serving=(), workers=()), "No detector runs", "fleetsight detector"),
        (replace(GOOD, serving=()), "No detector serves r1/front", "w1 runs"),
        (replace(GOOD, serving=(), workers=(WORKER, MODELLESS)), "No detector serves r1/front", "w1, w2 runs"),
        (replace(GOOD, serving=(), workers=(MODELLESS,)), "No detector has a model yet", "w2: no model is in force"),
        (replace(GOOD, serving=(BOXES_ONLY,)), "This model cannot do that", "has no masks"),
        (GOOD, WAITING, "some seconds"),
        (
            replace(GOOD, waited_s=FIRST_FRAME_TIMEOUT_S),
            WAITING,
            "Check in Health that a detector serves r1/front",
        ),
        (replace(GOOD, waited_s=FIRST_FRAME_TIMEOUT_S), WAITING, "read the log of w1"),
        (replace(GOOD, came=True), LATE, "may be overloaded"),
    ],
)
def test_the_first_thing_in_the_way_is_named_with_what_to_do(facts: Facts, title: str, advice: str) -> None:
    reason = why_nothing(FRONT, Stream.OVERLAY_SEGMENTATION, "detector", facts)
    assert title in reason.title
    assert advice in reason.advice


def test_boxes_are_drawn_without_masks() -> None:
    facts = replace(GOOD, serving=(BOXES_ONLY,))
    assert why_nothing(FRONT, Stream.OVERLAY_DETECTION, "detector", facts).title == WAITING


def test_a_worker_serves_what_it_says_it_serves_now() -> None:
    assert serving(FRONT, [WORKER]) == (WORKER,)
    assert serving(CameraKey("r1", "rear"), [WORKER]) == ()
    idle = WorkerStatus(
        service="detector",
        worker="w2",
        model="m",
        sent_ns=1,
        cameras=[CameraLoad(robot="r1", camera="front", inferred=1, serving=False)],
    )
    assert serving(FRONT, [idle]) == ()
