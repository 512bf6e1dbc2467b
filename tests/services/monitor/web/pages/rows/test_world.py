import msgspec

from schemas.keys import CameraKey
from schemas.world import ChangeKind, Seer
from services.monitor.history.world_history import ObjectEvent
from services.monitor.web.pages.rows.world import IN_VIEW_NS, cameras_in_view, event_rows, object_facts
from tests.services.monitor.world.test_site_objects import thing

S = 10**9
NOW = 10**18
HTML = "<b onclick=x>"


def seer(robot: str, last_ns: int) -> Seer:
    return Seer(robot=robot, camera="front", last_ns=last_ns)


def event(kind: ChangeKind, **given: object) -> ObjectEvent:
    of = ObjectEvent(
        since_ns=NOW, until_ns=NOW, open=False, site="hall", object="a", kind=kind, name="box", x=3, y=4, by="r1"
    )
    return msgspec.structs.replace(of, **given)


def test_an_object_is_told_with_all_that_is_known_of_it() -> None:
    of = msgspec.structs.replace(
        thing("a", 1.5, 2),
        name=HTML,
        size=(1.2, 0.8, 0.15),
        yaw=0.5,
        first_ns=NOW - 7200 * S,
        last_ns=NOW - 5 * S,
        existence=0.9876,
        seen_by=[seer("r2", NOW - 5 * S), seer("r1", NOW - 300 * S)],
        velocity=(0.0, -1.5),
    )
    told = object_facts(of, ["dock", HTML], NOW)
    assert HTML not in told
    for said in (
        "1.50, 2.00 m, 0.50 m up, &plusmn; 0.10 m",
        "1.20 &times; 0.80 &times; 0.15 m (length, width, height), its length at 29&deg;",
        "2 h ago",
        ">now<",
        '<a class="fs-link" href="/cameras/r2/front">r2/front</a>, now',
        "r1/front</a>, 5 min ago",
        "98.8 % probable",
        "1.5 m/s towards the map's south",
        "dock, &lt;b",
    ):
        assert said in told


def test_less_is_told_of_an_object_of_which_less_is_known() -> None:
    told = object_facts(msgspec.structs.replace(thing("a", 1), existence=1.0, looked_ns=NOW - 60 * S), [], NOW)
    for said in ("in none", "nobody yet", ">99.9 %", "1 min ago"):
        assert said in told
    assert "Moves" not in told
    assert "x axis" not in told
    still = msgspec.structs.replace(thing("a", 1), velocity=(0.01, 0.0))
    assert "stands still" in object_facts(still, [], NOW)


def test_the_cameras_that_have_an_object_in_view_are_those_that_saw_it_just_now() -> None:
    seen_by = [seer("r1", NOW), seer("r2", NOW - IN_VIEW_NS), seer("r3", NOW - IN_VIEW_NS - 1)]
    of = msgspec.structs.replace(thing("a", 1), seen_by=seen_by)
    assert cameras_in_view(of, NOW) == [CameraKey("r1", "front"), CameraKey("r2", "front")]


def test_events_are_told_in_words() -> None:
    events = [
        event(ChangeKind.APPEARED),
        event(ChangeKind.MOVED, from_x=0.0, from_y=0.0),
        event(ChangeKind.GONE, by=""),
        event(ChangeKind.MERGED, into=HTML),
    ]
    told = event_rows(events, NOW + 60 * S)
    for said in (
        "at 3.0, 4.0 m, as r1 saw",
        "from 0.0, 0.0 to 3.0, 4.0 m, 5.0 m away, as r1 saw",
        "from 3.0, 4.0 m<",
        "into &lt;b onclick=x&gt;, which it turned out to be",
        "1 min ago",
    ):
        assert said in told
    assert HTML not in told
    assert [kind in told for kind in ("Appeared", "Moved", "Gone", "Merged")] == [True] * 4
