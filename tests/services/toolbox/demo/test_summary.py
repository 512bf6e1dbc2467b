from dataclasses import replace

import msgspec
import pytest

from schemas.status import ENDED, MISSING, NUMBERED, CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.toolbox.demo.processors import ProcessorUse
from services.toolbox.demo.summary import Summary, drops, percentile


def summary(*, lists: dict[str, int], ages_s: tuple[float, ...] = (0.1, 0.2), first: float | None = 6.5) -> Summary:
    return Summary(
        robots=["r1", "r2"],
        sent={"r1": 10, "r2": 9},
        inferred=15,
        dropped={"at the gateway: malformed": 2, "at the detector: replaced": 1},
        lists=lists,
        ages_s=ages_s,
        first_list_s=first,
    )


def test_a_complete_run() -> None:
    run = summary(lists={"r1": 8, "r2": 7})
    assert run.complete
    assert run.lines() == [
        "frames sent:          19 (r1 10, r2 9)",
        "frames inferred:      15",
        "frames dropped:       1 at the detector: replaced, 2 at the gateway: malformed",
        "frames under way:     1 when it was stopped",
        "class lists received: 15 (r1 8, r2 7)",
        "first class list:     6.50 s after the start",
        "age p50 / p99:        0.10 s / 0.20 s",
        "result:               every robot was seen",
    ]


def test_it_says_whether_the_machine_was_too_slow() -> None:
    run = summary(lists={"r1": 8, "r2": 7}, ages_s=(4.0, 9.0))
    *_, machine, result = replace(run, processors=ProcessorUse(count=2, busy=0.634, own=0.38)).lines()
    assert machine == "machine:              2 processors, 63% busy, 38% with the demo"
    assert result == "result:               every robot was seen"
    *_, machine, result = replace(run, processors=ProcessorUse(count=2, busy=0.97, own=0.38)).lines()
    assert machine == (
        "machine:              too slow for this (2 processors, 97% busy, 38% with the demo), which raises "
        "ages and drops: close other programs, or ask for less with --robots and --hz"
    )
    assert result == "result:               every robot was seen"


@pytest.mark.parametrize("lists", [{}, {"r1": 8}, {"r1": 8, "r2": 0}])
def test_a_robot_that_was_not_seen_fails_the_run(lists: dict[str, int]) -> None:
    run = summary(lists=lists)
    assert not run.complete
    assert run.lines()[-1].startswith("result:               no class list from")
    assert run.lines()[-1].endswith("r2")


def test_nothing_happened() -> None:
    run = Summary(robots=["r1"], sent={}, inferred=0, dropped={}, lists={}, ages_s=(), first_list_s=None)
    assert not run.complete
    assert "age p50 / p99:        - / -" in run.lines()
    assert "frames dropped:       none" in run.lines()


@pytest.mark.parametrize(
    ("count", "percent", "rank"), [(1, 99, 1), (2, 50, 1), (100, 99, 99), (101, 99, 100), (4, 50, 2)]
)
def test_percentile_is_by_nearest_rank(count: int, percent: int, rank: int) -> None:
    assert percentile([float(number) for number in range(1, count + 1)], percent) == rank


def test_drops_are_added_up_by_place_and_reason() -> None:
    stream = StreamStatus(
        camera="c", stream="color", topic="/t", wanted=True, publishers=1, received=5, forwarded=3, dropped={"bad": 2}
    )
    depth = msgspec.structs.replace(stream, stream="depth")
    gateways = [
        GatewayStatus(robot=robot, boot_id="b", clock_id="c", sent_ns=0, streams=[stream, depth]) for robot in "ab"
    ]
    gateways.append(GatewayStatus(robot="c", boot_id="b", clock_id="c", sent_ns=0, withdrawn={"bad": 1}))
    load = CameraLoad(robot="a", camera="c", inferred=1, dropped={"late": 3, "bad": 0})
    workers = [WorkerStatus(service="detector", worker="w", model="m", sent_ns=0, cameras=[load])]
    assert drops(gateways, workers) == {"at the gateway: bad": 5, "at the detector: late": 3}


@pytest.mark.parametrize("reason", sorted({*NUMBERED, ENDED}))
def test_what_the_gateway_numbered_and_left_out_is_not_counted_again_where_it_is_missing(reason: str) -> None:
    stream = StreamStatus(
        camera="c",
        stream="color",
        topic="/t",
        wanted=True,
        publishers=1,
        received=9,
        forwarded=6,
        dropped={reason: 3},
    )
    gateway = GatewayStatus(robot="a", boot_id="b", clock_id="c", sent_ns=0, streams=[stream])
    load = CameraLoad(robot="a", camera="c", inferred=4, dropped={MISSING: 5})
    worker = WorkerStatus(service="detector", worker="w", model="m", sent_ns=0, cameras=[load])
    assert drops([gateway], [worker]) == {f"at the gateway: {reason}": 3, "on the link: lost": 2}
