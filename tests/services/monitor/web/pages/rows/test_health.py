"""Rows of the health page."""

from dataclasses import replace

import msgspec
from nicegui.json import dumps

from schemas.header import MAX_COUNT
from schemas.status import CameraLoad, StreamStatus
from services.monitor.web.pages.rows.health import MAX_SHOWN, WorkerRates, dropped_cells, gateway_row, worker_row
from tests.services.monitor.web.pages.shown import NOW, S, camera, robot, shown, worker

COLOR = StreamStatus(
    camera="front",
    stream="color",
    topic="/image",
    wanted=True,
    publishers=1,
    received=9,
    forwarded=5,
    dropped={"late": 4},
    received_hz=30.0,
    forwarded_hz=2.0,
)


def test_a_rate_is_what_was_counted_between_two_accounts() -> None:
    rates = WorkerRates()
    assert rates.take([worker(frames=10, sent_ns=5 * S)]) == {}
    assert rates.take([worker(frames=30, sent_ns=7 * S)]) == {"detector/gpu-1": 10.0}
    assert rates.take([worker(frames=30, sent_ns=7 * S)]) == {"detector/gpu-1": 10.0}
    assert rates.take([worker(frames=0, sent_ns=8 * S)]) == {"detector/gpu-1": 0.0}
    assert rates.take([worker(frames=0, sent_ns=8 * S, online=False)]) == {}


def test_a_worker_that_is_forgotten_is_forgotten_here_too() -> None:
    rates = WorkerRates()
    rates.take([worker(frames=10, sent_ns=5 * S)])
    rates.take([])
    assert rates.take([worker(frames=30, sent_ns=7 * S)]) == {}


def test_a_worker_says_whom_it_serves_and_what_it_lost() -> None:
    row = worker_row(worker(cameras=MAX_SHOWN + 2, frames=100), 10.0, NOW)
    assert len(row["serves"]) == MAX_SHOWN
    assert (row["count"], row["more"]) == (MAX_SHOWN + 2, "and 2 more")
    assert row["serves"][0] == "r1/c0 at 5/s"
    assert (row["frames"], row["dropped"], row["reasons"]) == ("1.4k", "28", ((28, "late"),))


def test_a_worker_s_cameras_are_in_order_and_their_rates_have_digits_that_one_can_read() -> None:
    names = ("r10", "r2", "r1")
    loads = [CameraLoad(robot=name, camera="front", inferred=0, serving=True, budget_hz=3.51516) for name in names]
    of = worker()
    row = worker_row(replace(of, status=msgspec.structs.replace(of.status, cameras=loads)), 1.0, NOW)
    assert row["serves"] == ["r1/front at 3.52/s", "r2/front at 3.52/s", "r10/front at 3.52/s"]


def test_no_count_is_higher_than_a_page_can_take() -> None:
    cells = dropped_cells({"late": 3 * MAX_COUNT, "malformed": 2})
    assert cells["reasons"] == ((MAX_COUNT, "late"), (2, "malformed"))
    dumps(cells)


def test_versions_are_shown_where_they_are_known() -> None:
    of = worker()
    assert worker_row(of, 0.0, NOW)["version"] == "0.8"
    told = replace(of, status=msgspec.structs.replace(of.status, runtime="openvino-int8"))
    assert worker_row(told, 0.0, NOW)["runtime"] == "openvino-int8"
    known = robot()
    assert gateway_row(shown(known), NOW)["version"] == "0.9"
    assert gateway_row(shown(replace(known, gateway=None)), NOW)["version"] == ""


def test_a_worker_that_is_gone_serves_nobody() -> None:
    row = worker_row(worker(online=False), 0.0, NOW + 60 * S)
    assert (row["state"], row["count"], row["seen"]) == ("offline", 0, "1 min ago")


def test_a_gateway_shows_its_streams_and_who_looks_after_them() -> None:
    (stream,) = gateway_row(shown(robot(streams=[COLOR]), camera()), NOW)["streams"]
    assert (stream["in"], stream["out"], stream["served"]) == ("30.0/s", "2.0/s", "detector/gpu-1")
    assert (stream["dropped"], stream["reasons"]) == ("4", ((4, "late"),))


def test_what_a_gateway_that_is_gone_said_last_is_not_of_now() -> None:
    row = gateway_row(shown(robot(online=False, streams=[COLOR])), NOW)
    assert not row["live"]
    assert (row["streams"][0]["in"], row["streams"][0]["wanted"]) == ("\N{EN DASH}", False)
