from collections import Counter
from contextlib import ExitStack

from bus.sharing.work_counts import Tallies, Tally
from schemas import codec
from schemas.keys import CameraKey
from schemas.status import MAX_STREAMS, CameraLoad, WorkerStatus


def test_what_is_added_is_named_and_forgotten_where_it_was_counted() -> None:
    tally, dropped = Tally(CameraKey("r1", "front")), Counter({"too old": 2, "never": 0})
    tally.done = 3
    tally.add("points", dropped)
    assert not dropped
    tally.add("points", Counter({"too old": 1}))
    assert tally.load(serving=True) == CameraLoad(
        robot="r1", camera="front", inferred=3, dropped={"points: too old": 3}, serving=True
    )


def test_what_never_happened_is_not_listed() -> None:
    tally = Tally(CameraKey("r1", "front"))
    tally.done = 3
    tally.dropped["late"] += 2
    tally.dropped["double"] += 0
    assert tally.load(serving=True) == CameraLoad(
        robot="r1", camera="front", inferred=3, dropped={"late": 2}, serving=True
    )


def test_no_count_is_higher_than_a_message_can_hold() -> None:
    tally = Tally(CameraKey("r1", "front"))
    tally.done = 2**63
    tally.dropped["too old"] = 2**70
    status = WorkerStatus(service="s", worker="w", model="", sent_ns=0, cameras=[tally.load(serving=True)])
    read = codec.decode(WorkerStatus, codec.encode(status), codec.encoding(WorkerStatus))
    assert (read.cameras[0].inferred, read.cameras[0].dropped) == (2**63 - 1, {"too old": 2**63 - 1})


def test_the_tallies_of_cameras_that_were_served_longest_ago_make_room() -> None:
    tallies = Tallies(Tally, most=2)
    first, second, third, fourth = (CameraKey("r1", f"c{number}") for number in range(4))
    with tallies.serving(first) as tally:
        tally.done = 3
        with tallies.serving(second):
            pass
        assert loads(tallies) == {"c0": (3, True), "c1": (0, False)}
        with tallies.serving(third):
            assert loads(tallies) == {"c0": (3, True), "c2": (0, True)}
            with tallies.serving(fourth):
                assert loads(tallies) == {"c0": (3, True), "c2": (0, True), "c3": (0, True)}
    with tallies.serving(second):
        assert loads(tallies) == {"c3": (0, False), "c1": (0, True)}


def test_a_camera_that_is_served_again_goes_on_from_where_it_was() -> None:
    tallies = Tallies(Tally, most=2)
    first, second, third = (CameraKey("r1", f"c{number}") for number in range(3))
    for camera in (first, second, first, third):
        with tallies.serving(camera) as tally:
            tally.done += 1
    assert loads(tallies) == {"c0": (2, False), "c2": (1, False)}


def test_no_more_are_said_than_a_status_holds() -> None:
    tallies = Tallies(Tally)
    with ExitStack() as stack:
        for number in range(MAX_STREAMS + 1):
            stack.enter_context(tallies.serving(CameraKey("r1", f"c{number}")))
        assert [load.camera for load in tallies.loads()] == [f"c{number}" for number in range(1, MAX_STREAMS + 1)]
    with tallies.serving(CameraKey("r1", "another")):
        assert len(tallies.loads()) == MAX_STREAMS


def test_cameras_that_are_served_are_said_before_those_that_were() -> None:
    tallies = Tallies(Tally)
    first, *others = (CameraKey("r1", f"c{number}") for number in range(MAX_STREAMS + 1))
    with tallies.serving(first):
        with ExitStack() as stack:
            for camera in others:
                stack.enter_context(tallies.serving(camera))
        said = loads(tallies)
    assert len(said) == MAX_STREAMS
    assert said["c0"] == (0, True)


def test_what_was_asked_of_a_camera_is_said_with_its_counts() -> None:
    tallies = Tallies(Tally)
    first, second = (CameraKey("r1", f"c{number}") for number in range(2))
    with tallies.serving(first), tallies.serving(second):
        budgets = {load.camera: load.budget_hz for load in tallies.loads({first: 2.5})}
    assert budgets == {"c0": 2.5, "c1": None}


def loads(tallies: Tallies[Tally]) -> dict[str, tuple[int, bool]]:
    return {load.camera: (load.inferred, load.serving) for load in tallies.loads()}
