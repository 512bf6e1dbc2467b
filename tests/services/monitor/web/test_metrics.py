"""Metrics and health."""

import re
import time
from pathlib import Path
from typing import Final

import msgspec
import pytest
from prometheus_client.parser import text_string_to_metric_families

from bus import BusSettings, open_bus
from bus.fake import FakeNetwork
from bus.session.link_use import LinkUse
from schemas.keys import CameraKey
from schemas.status import BEYOND_USE, THINNED, CameraLoad, StreamStatus, WorkerStatus
from services.monitor.alerting.webhooks import Outcome
from services.monitor.liveness import STALLED_S
from services.monitor.web.metrics import MAX_LABELLED, metrics_of
from services.monitor.world.site_objects import World
from tests.contract.conftest import free_endpoint
from tests.services.monitor.web.api.seeing import ODD, fill
from tests.services.monitor.web.asking import Web, web_in
from tests.services.monitor.web.pages.rows.test_warehouses import report_of
from tests.services.monitor.web.serving import monitor_on
from tests.services.monitor.world.test_site_objects import DOCK, thing
from tests.services.monitor.world.test_site_status import status as site_status
from tests.waiting import until


async def test_links_are_counted_against_how_many_there_can_be() -> None:
    endpoint = free_endpoint()
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus:
        monitor = monitor_on(bus)
        async with open_bus(BusSettings(connect=[endpoint])), open_bus(BusSettings(connect=[endpoint])):
            await until(lambda: bus.links.count == 2)
            said = (await metrics_of(monitor)).decode().splitlines()
            assert "fleetsight_links 2.0" in said
            assert f"fleetsight_links_limit {float(bus.links.limit)}" in said
        await until(lambda: bus.links.count == 0)
        assert monitor.problems() == []


async def test_links_that_are_nearly_all_taken_are_a_problem_of_the_monitor(monkeypatch: pytest.MonkeyPatch) -> None:
    async with FakeNetwork().open_bus() as bus:
        monkeypatch.setattr(type(bus), "links", LinkUse(9, 10))
        monitor = monitor_on(bus)
        assert monitor.problems() == [LinkUse(9, 10).problem]
        assert "fleetsight_mesh_up 1.0" in (await metrics_of(monitor)).decode()


PAGE: Final = Path(__file__).parents[4] / "docs" / "monitor.md"


async def test_health_of_a_monitor_that_hears_and_keeps(web: Web) -> None:
    async with web.stranger() as stranger:
        answer = await stranger.get("/healthz")
        assert (answer.status_code, answer.json()) == (200, {"status": "ok"})


async def test_open_links_are_told_to_all(tmp_path: Path) -> None:
    open_to_all = {"listen": ["tcp/0.0.0.0:7447"], "insecure": True}
    async with web_in(tmp_path, **open_to_all) as web, web.stranger() as stranger, await web.program() as program:
        answer = (await stranger.get("/healthz")).json()
        assert answer["status"] == "ok"
        assert answer["insecure"].startswith("links are open (--insecure)")
        assert answer["insecure"] in (await program.get("/api/v1/status")).json()["problems"]


async def test_a_dead_mesh_is_told_to_all_and_why_to_those_who_are_logged_in(web: Web) -> None:
    web.monitor.health._heard_s -= 2 * STALLED_S
    async with web.stranger() as stranger, await web.program() as program:
        answer = await stranger.get("/healthz")
        assert (answer.status_code, answer.json()["status"]) == (503, "dead")
        assert answer.json()["reason"] == "the fleet cannot be heard"
        reason = "nothing has arrived on the bus for 2"
        assert (await program.get("/healthz")).json()["reason"].startswith(reason)
        (problem,) = (await program.get("/api/v1/status")).json()["problems"]
        assert problem.startswith(reason)


async def test_a_history_that_is_not_kept_is_degraded_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "history.db").mkdir()
    history = f"sqlite:///{tmp_path / 'history.db'}"
    async with web_in(tmp_path, history=history) as web, web.stranger() as stranger, await web.program() as program:
        answer = await stranger.get("/healthz")
        assert (answer.status_code, answer.json()) == (
            200,
            {"status": "degraded", "reason": "", "degraded": ["the history is not being kept"]},
        )
        told = (await program.get("/healthz")).json()
        assert told["degraded"] == ["the history is not being kept"]
        assert "unable to open database file" in told["details"]["the history is not being kept"]


async def test_metrics_are_prometheus_own_text_whatever_things_are_called(web: Web) -> None:
    fill(web.monitor.fleet)
    web.monitor.fleet.left_out[ODD] += 3
    web.monitor.fleet.inventory.refused[CameraKey("r1", "front")] += 7
    web.monitor.fleet.inventory.ignored_opinions += 8
    web.monitor.fleet.inventory.ignored_distances += 9
    web.monitor.alerting._delivery.webhooks.counts[ODD, Outcome.DROPPED] += 6
    async with await web.program() as program:
        answer = await program.get("/metrics")
        assert answer.headers["Content-Type"] == "text/plain; version=0.0.4; charset=utf-8"
        found = {
            (sample.name, *sample.labels.values()): sample.value
            for family in text_string_to_metric_families(answer.text)
            for sample in family.samples
        }
        assert found["fleetsight_robot_online", "r1"] == 1
        assert found["fleetsight_robot_online", "r2"] == 0
        assert found["fleetsight_gateway_info", "r1", ODD] == 1
        assert found["fleetsight_worker_info", "detector", "0.9", "w1"] == 1
        assert found["fleetsight_robot_frames_dropped_total", f"gateway: {ODD}", "r1"] == 4
        assert found["fleetsight_messages_left_out_total", ODD] == 3
        assert found["fleetsight_webhook_alerts_total", "dropped", ODD] == 6
        assert found["fleetsight_camera_class_lists_refused_total", "front", "r1"] == 7
        assert found["fleetsight_opinions_ignored_total",] == 8
        assert found["fleetsight_distances_ignored_total",] == 9
        assert found["fleetsight_worker_frames_inferred_total", "detector", "w1"] == 5
        assert found["fleetsight_worker_frames_dropped_total", "late", "detector", "w1"] == 2
        assert found["fleetsight_worker_busy_seconds_total", "detector", "w1"] == 1.5
        assert found["fleetsight_camera_frames_beyond_use_total", "front", "r1"] == 0


@pytest.mark.parametrize(
    ("service", "budget_hz", "said"), [("detector", 2.5, [30.0]), ("detector", None, []), ("opinion", 2.0, [])]
)
async def test_frames_left_out_for_detectors_that_cannot_keep_up_are_demand(
    service: str, budget_hz: float | None, said: list[float]
) -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor, now_ns = monitor_on(bus), time.time_ns()
        fill(monitor.fleet)
        streams = [
            StreamStatus(
                camera=camera,
                stream=stream,
                topic="t",
                wanted=True,
                publishers=1,
                received=99,
                forwarded=9,
                dropped={BEYOND_USE: left_out, THINNED: 7},
            )
            for camera, stream, left_out in (("front", "color", 30), ("front", "depth", 5), ("rear", "color", 8))
        ]
        monitor.fleet.gateway_status(msgspec.structs.replace(monitor.fleet.gateways["r1"], streams=streams), now_ns)
        load = CameraLoad(robot="r1", camera="front", inferred=5, serving=True, budget_hz=budget_hz)
        del monitor.fleet.workers["detector", "w1"]
        worker = WorkerStatus(service=service, worker="w1", model="", sent_ns=now_ns, cameras=[load])
        monitor.fleet.worker_status(worker, now_ns)
        text = (await metrics_of(monitor)).decode()
    (left_out,) = (
        family
        for family in text_string_to_metric_families(text)
        if family.name == "fleetsight_camera_frames_beyond_use"
    )
    assert [sample.value for sample in left_out.samples] == said
    assert not re.search(r"^fleetsight_worker_busy_seconds_total", text, re.MULTILINE), "it does not say"


async def test_the_page_of_the_monitor_names_every_metric(web: Web) -> None:
    fill(web.monitor.fleet)
    web.monitor.fleet.left_out["malformed messages"] += 1
    web.monitor.fleet.inventory.refused[CameraKey("r1", "front")] += 1
    report_of(web.monitor.fleet, "berlin")
    web.monitor.fleet.sites.take(site_status("hall", box=1), time.time_ns())
    web.monitor.fleet.world = World([DOCK])
    web.monitor.fleet.world.sites["hall"].replace("e", 0, [thing("a", 1)])
    web.monitor.alerting._delivery.webhooks.counts["ops", Outcome.GIVEN_UP] += 1
    async with await web.program() as program:
        text = (await program.get("/metrics")).text
    samples = [sample for family in text_string_to_metric_families(text) for sample in family.samples]
    found = {sample.name: set(sample.labels) for sample in samples}
    page = PAGE.read_text(encoding="utf-8")
    named = re.findall(r"^\| `(fleetsight_\w+)` \|([^|]*)\|", page, re.MULTILINE)
    assert [(name, set(re.findall(r"\w+", labels))) for name, labels in sorted(named)] == sorted(found.items())
    assert set(re.findall(r"fleetsight_\w+", page)) == found.keys()


async def test_a_flood_of_robots_is_no_flood_of_series(web: Web) -> None:
    for number in range(MAX_LABELLED + 7):
        web.monitor.fleet.robot_presence(f"r{number}", alive=True)
    async with await web.program() as program:
        text = (await program.get("/metrics")).text
        assert text.count("fleetsight_robot_online{") == MAX_LABELLED
        assert "fleetsight_unlabelled 7.0" in text
        assert "# HELP fleetsight_unlabelled Robots, cameras and workers over the limit, without series." in text


async def test_metrics_are_open_where_the_settings_say_so(tmp_path: Path) -> None:
    async with web_in(tmp_path, web_open_metrics=True) as web, web.stranger() as stranger:
        assert (await stranger.get("/metrics")).status_code == 200
        assert (await stranger.get("/api/v1/me")).status_code == 401
