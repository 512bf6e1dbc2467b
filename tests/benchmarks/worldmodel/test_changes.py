from math import inf

import pytest

from benchmarks.worldmodel.changes import ChangeScore, ChangeWatch, StandingScore
from benchmarks.worldmodel.recording import (
    ObjectChange,
    RecordedChanges,
    RecordedImage,
    TrueObject,
    VisibleObject,
    record_changes,
)
from benchmarks.worldmodel.scoring import FoundObject
from schemas.detections import Detections
from schemas.header import Header
from services.training.dataset import holdout_seed

HEADER = Header(robot="r1", camera="camera", boot_id="b", seq=1, stamp_ns=1, frame_id="f", received_ns=1)
NOTHING = Detections(header=HEADER, height=48, width=64, objects=[], model="", worker="w")
HERE, THERE = (1.0, 0.0, 0.2), (4.0, 0.0, 0.2)


def true(instance: int, at: tuple[float, float, float] = HERE, name: str = "pallet") -> TrueObject:
    return TrueObject(instance=instance, name=name, centre=at, size=(1.2, 0.8, 0.144))


def found(name: str, at: tuple[float, float, float] = HERE) -> FoundObject:
    return FoundObject(name, "pallet", at)


def image(second: float, *, visible: tuple[int, ...] = (), missing: tuple[int, ...] = ()) -> RecordedImage:
    shown, gone = ([VisibleObject(each, 0.01, 0.9) for each in some] for some in (visible, missing))
    return RecordedImage(
        detections=NOTHING, depth_png=b"", pose=[], visible=shown, shown=[], second=second, missing=gone
    )


def change(
    begins_s: float, ends_s: float, before: tuple[float, float, float] | None, after: tuple[float, float, float] | None
) -> ObjectChange:
    return ObjectChange(
        instance=7, name="pallet", kind="moved", begins_s=begins_s, ends_s=ends_s, before=before, after=after
    )


def watch(*changes: ObjectChange, score: ChangeScore) -> ChangeWatch:
    objects = [true(7), true(8, (8.0, 8.0, 0.2))]
    return ChangeWatch(RecordedChanges(hz=2.0, start=0, images=[], objects=objects, changes=list(changes)), score)


def test_it_is_counted_from_the_first_look_at_where_something_is_gone() -> None:
    score = ChangeScore()
    watched = watch(change(1.0, 1.0, HERE, None), score=score)
    known = [found("a")]
    watched.add(image(0.5, visible=(7,)), known)
    watched.add(image(2.0, missing=(7,)), known)
    for second in (4.0, 4.5, 5.0):
        watched.add(image(second, missing=(7,)), known)
    watched.add(image(6.5, missing=(7,)), [])
    watched.end(60.0)
    assert (score.gone_s, score.new_s) == ([2.5], [])
    assert (score.summary()["noticed"], score.summary()["noticed_p95_s"]) == (1.0, 2.5)


def test_what_is_never_noticed_counts_and_what_nobody_could_see_or_nobody_knew_does_not() -> None:
    for first, known, ends_s, expected in (
        (4.0, True, 60.0, [inf]),
        (4.0, True, 6.5, []),
        (None, True, 60.0, []),
        (4.0, False, 60.0, []),
    ):
        score = ChangeScore()
        watched = watch(change(1.0, 1.0, HERE, None), score=score)
        objects = [found("a")] if known else []
        watched.add(image(0.5), objects)
        for second in (4.0, 4.5, 5.0):
            watched.add(image(second, missing=() if first is None else (7,)), objects)
        watched.end(ends_s)
        assert score.gone_s == expected
        assert score.summary()["noticed_p95_s"] is None


def test_a_glance_is_no_look() -> None:
    score = ChangeScore()
    watched = watch(change(1.0, 1.0, HERE, None), score=score)
    watched.add(image(0.5), [found("a")])
    for second in (4.0, 4.5, 20.0, 30.0):
        watched.add(image(second, missing=(7,)), [found("a")])
    watched.end(60.0)
    assert score.gone_s == []
    watched = watch(change(1.0, 1.0, HERE, None), score=score)
    watched.add(image(0.5), [found("a")])
    watched.add(image(4.0, missing=(7,)), [found("a")])
    watched.add(image(5.0, missing=(7,)), [])
    assert score.gone_s == [1.0]


def test_what_comes_is_noticed_once_it_is_known_at_its_place() -> None:
    score = ChangeScore()
    watched = watch(change(1.0, 1.0, HERE, None), change(9.0, 9.0, None, THERE), score=score)
    watched.add(image(0.5), [found("a")])
    watched.add(image(2.0, missing=(7,)), [])
    watched.add(image(10.0, visible=(7,)), [])
    watched.add(image(12.0, visible=(7,)), [found("b", THERE)])
    assert score.new_s == [2.0]
    assert (score.moved_unseen, score.new_id, score.seen_moving) == (1, 1, 0)


@pytest.mark.parametrize(
    ("seen", "now", "counts"),
    [
        ((1.5, 2.5, 3.5), "a", (1, 1, 0, 0)),
        ((1.5, 2.5, 3.5), "b", (1, 0, 0, 0)),
        ((1.5, 2.5), "b", (0, 0, 0, 0)),
        ((), "a", (0, 0, 1, 0)),
        ((), "b", (0, 0, 1, 1)),
        ((1.5,), "b", (0, 0, 0, 0)),
    ],
)
def test_what_is_seen_moving_keeps_its_id_and_what_is_not_gets_another_one(
    seen: tuple[float, ...], now: str, counts: tuple[int, ...]
) -> None:
    score = ChangeScore()
    watched = watch(change(1.0, 4.0, HERE, THERE), score=score)
    watched.add(image(0.5), [found("a")])
    for second in seen:
        watched.add(image(second, visible=(7,)), [found("a")])
    watched.add(image(4.5, visible=(7,)), [found(now, THERE)])
    assert (score.seen_moving, score.kept_id, score.moved_unseen, score.new_id) == counts
    assert score.new_s == [0.0]


def test_what_comes_back_to_its_place_has_not_gone() -> None:
    score = ChangeScore()
    watched = watch(change(1.0, 8.0, HERE, HERE), score=score)
    for second in (0.5, 2.0, 8.5, 20.0):
        watched.add(image(second, missing=(7,) if second == 2.0 else ()), [found("a")])
    watched.end(60.0)
    assert (score.gone_s, score.new_s) == ([], [])


def test_an_object_is_wrongly_gone_if_nothing_else_stands_for_the_true_one() -> None:
    score = StandingScore(false_moved=2, object_minutes=10.0, still_minutes=4.0)
    score.add_gone(found("a"), [], [true(7)])
    score.add_gone(found("a"), [found("b", (1.1, 0.0, 0.2))], [true(7)])
    score.add_gone(found("a", THERE), [], [true(7)])
    assert score.summary() == {"false_gone": 0.1, "false_moved": 0.5}
    assert StandingScore().summary() == {"false_gone": None, "false_moved": None}


def test_a_changing_warehouse_is_recorded_with_what_changes_in_it() -> None:
    made = record_changes(holdout_seed(1, 300_000), 2, 0.2, lambda _: [], start_s=10.0, seconds=60.0)
    assert [each.second for each in made.images[:3]] == [0.0, 2.5, 5.0]
    assert [each.detections.header.robot for each in made.images[:3]] == ["r1", "r2", "r1"]
    assert len(made.images) == 24
    start = {each.instance: each.centre for each in made.objects}
    assert made.changes
    for each in made.changes:
        assert each.before == pytest.approx(start[each.instance]) or each.begins_s > made.changes[0].begins_s
        assert (each.after is None) == (each.kind == "taken")
        assert 0 <= each.begins_s <= 60
    left = {each.instance for each in made.changes}
    assert {seen.instance for each in made.images for seen in each.missing} <= left
    gone = {each.instance: each.begins_s for each in made.changes if each.after is None}
    back = {each.instance for each in made.changes if each.kind == "brought"}
    for shown in made.images:
        there = {seen.instance for seen in shown.visible}
        assert not there & {each for each, second in gone.items() if second < shown.second and each not in back}
