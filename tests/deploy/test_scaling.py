"""Detectors follow a simulated load: the monitor's own metrics, the chart's query, Prometheus' own evaluation."""

import random
import re
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from bus import Bus
from bus.fake import FakeNetwork
from schemas.keys import CameraKey
from schemas.status import BEYOND_USE, CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.detector.frame_counts import REPLACED, STALE, TOO_MANY
from services.monitor.liveness import STALLED_S
from services.monitor.monitor import Monitor
from services.monitor.web.metrics import metrics_of
from tests.deploy.support.helm import NAME, RULES, find, render
from tests.deploy.support.prometheus import SCRAPE_S, Scaler, Series, check_rules
from tests.services.monitor.web.serving import monitor_on

CAMERAS = [f"c{number}" for number in range(24)]
CALL_S = 0.05
"""What a worker needs for a frame."""

START_S = 45
"""Until a new pod has its model loaded and its cameras."""


@pytest.fixture(scope="module")
def scaled() -> dict[str, Any]:
    spec = find(render({"detector": {"autoscaling": {"enabled": True}}}), "ScaledObject", "detector")["spec"]
    assert isinstance(spec, dict)
    return spec


@pytest.fixture(scope="module")
def query(scaled: dict[str, Any]) -> str:
    return str(scaled["triggers"][0]["metadata"]["query"])


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    async with FakeNetwork().open_bus() as made:
        yield made


class Site:
    """Cameras of a robot and detectors that share them; those that have too little time throttle their gateway."""

    def __init__(self, bus: Bus) -> None:
        self.monitors = [monitor_on(bus), monitor_on(bus)]
        self._left_out = Counter[str]()
        self._done = Counter[tuple[str, str]]()
        self._lost = Counter[tuple[str, str]]()
        self._busy_s = Counter[str]()
        for monitor in self.monitors:
            monitor.fleet.robot_presence("r1", alive=True)
            for camera in CAMERAS:
                monitor.fleet.camera_presence(CameraKey("r1", camera), alive=True)

    def pass_time(self, wanted_hz: float, workers: Sequence[str]) -> None:
        """Let SCRAPE_S pass in which cameras have so many frames a second, all together."""
        each = wanted_hz * SCRAPE_S / len(CAMERAS)
        share = [CAMERAS[number :: len(workers)] for number in range(len(workers))]
        limited = []
        for worker, cameras in zip(workers, share, strict=True):
            possible = SCRAPE_S / CALL_S / len(cameras)
            done = min(each, possible)
            lost = min(each - done, done * 0.05)
            self._busy_s[worker] += done * len(cameras) * CALL_S  # type: ignore[assignment]
            for camera in cameras:
                self._done[worker, camera] += round(done)
                self._lost[worker, camera] += round(lost)
                self._left_out[camera] += round(each - done - lost)
            limited += cameras if each > possible else []
        self._report(dict(zip(workers, share, strict=True)), limited)

    def _report(self, share: dict[str, list[str]], limited: Sequence[str]) -> None:
        now_ns = time.time_ns()
        streams = [
            StreamStatus(
                camera=camera,
                stream="color",
                topic="t",
                wanted=True,
                publishers=1,
                received=0,
                forwarded=0,
                dropped={BEYOND_USE: self._left_out[camera]},
            )
            for camera in CAMERAS
        ]
        gateway = GatewayStatus(robot="r1", boot_id="b", clock_id="c", sent_ns=now_ns, streams=streams)
        for monitor in self.monitors:
            monitor.health._heard_s = time.monotonic()
            monitor.fleet.gateway_status(gateway, now_ns)
        for worker, busy_s in self._busy_s.items():
            serves = share.get(worker, ())
            loads = [
                CameraLoad(
                    robot="r1",
                    camera=camera,
                    inferred=done,
                    dropped={REPLACED: self._lost[name, camera]},
                    serving=camera in serves,
                    budget_hz=1.0 if camera in limited and camera in serves else None,
                )
                for (name, camera), done in self._done.items()
                if name == worker
            ]
            status = WorkerStatus(
                service="detector", worker=worker, model="", sent_ns=now_ns, cameras=loads, busy_s=busy_s
            )
            for monitor in self.monitors:
                monitor.fleet.worker_status(status, now_ns)

    async def text(self, monitor: int = 0) -> str:
        """Return what a monitor's /metrics says."""
        return (await metrics_of(self.monitors[monitor])).decode()


@pytest.fixture
def site(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.setattr("services.monitor.monitor.MAX_AGE_S", -1.0)  # a minute here takes milliseconds
    return Site(bus)


async def numbers_of_pods(site: Site, scaled: dict[str, Any], series: Series, loads_hz: Iterable[float]) -> list[int]:
    """Return how many pods there are to be after each SCRAPE_S in which cameras have so many frames a second."""
    scaler, query = Scaler(scaled), scaled["triggers"][0]["metadata"]["query"]
    pods, counts = [("w0", 0.0)], list[int]()
    for step, wanted_hz in enumerate(loads_hz):
        now_s = step * SCRAPE_S
        site.pass_time(wanted_hz, [name for name, ready_s in pods if ready_s <= now_s])
        series.scrape(await site.text())
        wished = scaler.decide(series.value(query), len(pods), now_s)
        pods = [*pods[:wished], *((f"w{step}-{number}", now_s + START_S) for number in range(wished - len(pods)))]
        counts.append(wished)
    return counts


async def test_one_worker_becomes_six_and_one_again_and_none_flaps(
    site: Site, scaled: dict[str, Any], tmp_path: Path
) -> None:
    noise = random.Random(1)  # noqa: S311 - the same numbers each time
    loads_hz = [wanted_hz * noise.uniform(0.85, 1.15) for wanted_hz in [10] * 10 + [80] * 50 + [10] * 50]
    counts = await numbers_of_pods(site, scaled, Series(tmp_path), loads_hz)
    changes = [count for before, count in zip([0, *counts], counts, strict=False) if count != before]
    top = changes.index(6)
    assert changes == [*sorted(changes[: top + 1]), *sorted(changes[top + 1 :], reverse=True)], counts
    assert (changes[0], max(changes), changes[-1]) == (1, 6, 1)
    assert len(set(changes[: top + 1])) == top + 1
    assert counts[40:60] == [6] * 20


@pytest.mark.parametrize("wanted_hz", [83, 98])
async def test_a_load_at_the_edge_of_one_worker_more_does_not_flap(
    site: Site, scaled: dict[str, Any], tmp_path: Path, wanted_hz: float
) -> None:
    noise = random.Random(2)  # noqa: S311 - the same numbers each time
    loads_hz = [wanted_hz * noise.uniform(0.9, 1.1) for _ in range(40)]
    counts = await numbers_of_pods(site, scaled, Series(tmp_path), loads_hz)
    settled = wanted_hz * CALL_S / float(scaled["triggers"][0]["metadata"]["threshold"])
    assert counts == sorted(counts)
    assert abs(counts[-1] - settled) <= 1


async def test_what_gateways_left_out_is_most_of_the_demand(site: Site, query: str, tmp_path: Path) -> None:
    series, blind = Series(tmp_path), Series(tmp_path)
    for _ in range(12):
        site.pass_time(80, ["w0"])
        text = await site.text()
        series.scrape(text)
        blind.scrape("\n".join(line for line in text.splitlines() if "beyond_use" not in line) + "\n")
    load, seen_by_drops_alone = series.value(query), blind.value(query)
    assert load == pytest.approx(4, rel=0.05)
    assert seen_by_drops_alone == pytest.approx(1.05, rel=0.05)


async def test_the_load_does_not_depend_on_how_many_share_it(site: Site, query: str, tmp_path: Path) -> None:
    loads = []
    for workers in (["a"], ["b0", "b1", "b2"], [f"c{number}" for number in range(6)]):
        series = Series(tmp_path)
        for _ in range(12):
            site.pass_time(80, workers)
            series.scrape(await site.text())
        loads.append(series.value(query))
    assert loads == pytest.approx([4, 4, 4], rel=0.05)


async def test_two_monitors_do_not_double_the_load(site: Site, query: str, tmp_path: Path) -> None:
    series = Series(tmp_path)
    for _ in range(12):
        site.pass_time(80, ["w0", "w1"])
        series.scrape(await site.text(0), 'instance="m0"')
        series.add(await site.text(1), 'instance="m1"')
    assert series.value(query) == pytest.approx(4, rel=0.05)


async def test_a_fleet_at_rest_has_no_load(site: Site, query: str, tmp_path: Path) -> None:
    series = Series(tmp_path)
    for _ in range(12):
        site.pass_time(0, ["w0"])
        series.scrape(await site.text())
    assert series.value(query) == 0


async def test_no_load_is_told_while_nobody_knows_it(site: Site, query: str, tmp_path: Path) -> None:
    series = Series(tmp_path)
    site.pass_time(80, ["w0"])
    text = await site.text()
    for number in range(12):
        monitor: Monitor = site.monitors[0]
        if number == 8:
            monitor.health._heard_s -= 2 * STALLED_S
        series.scrape(await site.text())
    assert series.value(query) is None, "a monitor that hears nothing"
    assert "fleetsight_mesh_up 1.0" in text
    gone = Series(tmp_path)
    for _ in range(12):
        gone.scrape("up 0\n")
    assert gone.value(query) is None, "no monitor"


async def test_fleets_are_told_apart_by_the_labels_of_the_chart(site: Site, tmp_path: Path) -> None:
    values = {"detector": {"autoscaling": {"enabled": True, "matchers": 'namespace="north"'}}}
    scaled = find(render(values), "ScaledObject", "detector")["spec"]
    series = Series(tmp_path)
    for _ in range(12):
        site.pass_time(80, ["w0"])
        series.scrape(await site.text(), 'namespace="south"')
    assert series.value(scaled["triggers"][0]["metadata"]["query"]) is None


@pytest.mark.parametrize("service", ["distance", "cloud"])
@pytest.mark.parametrize(
    "tls", [{}, {"monitor": "m", "detector": "d", "space": "s1", "worldmodel": "w", "access": "a"}]
)
async def test_workers_in_the_cluster_follow_their_own_load(
    site: Site, tmp_path: Path, service: str, tls: dict[str, str]
) -> None:
    scaling = {"detector": {"autoscaling": {"matchers": 'job="fleet"'}}, service: {"autoscaling": {"enabled": True}}}
    (scaled,) = (each for each in render({**scaling, "tls": tls}) if each["kind"] == "ScaledObject")
    assert scaled["spec"]["scaleTargetRef"] == {"name": f"{NAME}-{service}"}
    query = scaled["spec"]["triggers"][0]["metadata"]["query"]
    own = "s1" if tls else f"{NAME}-{service}"
    names = {"r7": "r7-300-beef", "another": f"{own}0-7-cafe", "cluster": f"{own}-5d9-x2x-7-cafe"}
    series = Series(tmp_path)
    for step in range(12):
        for place, worker in names.items():
            done = 30 * step
            camera = CameraLoad(
                robot="r7" if place == "r7" else "r1",
                camera=CAMERAS[0],
                inferred=done,
                dropped={"replaced by newer detections": 4 * done},
                serving=True,
            )
            busy_s = 0.8 * SCRAPE_S * step
            status = WorkerStatus(
                service=service, worker=worker, model="", sent_ns=time.time_ns(), cameras=[camera], busy_s=busy_s
            )
            site.monitors[0].fleet.worker_status(status, time.time_ns())
        site.pass_time(0, ["w0"])
        series.scrape(await site.text(), 'job="fleet"')
    assert series.value(query) == pytest.approx(0.8, rel=0.05)


@pytest.mark.parametrize("service", ["distance", "cloud"])
async def test_workers_with_depth_grow_and_shrink_with_their_load_and_do_not_flap(
    site: Site, tmp_path: Path, service: str
) -> None:
    """Those that cannot keep up are busy all the time: how much more there is to do nobody knows."""
    (scaled,) = (
        each["spec"] for each in render({service: {"autoscaling": {"enabled": True}}}) if each["kind"] == "ScaledObject"
    )
    scaler, query = Scaler(scaled), scaled["triggers"][0]["metadata"]["query"]
    noise = random.Random(3)  # noqa: S311 - the same numbers each time
    series, pods, counts, busy_s = Series(tmp_path), [("w0", 0.0)], list[int](), Counter[str]()
    for step, load in enumerate([0.4] * 10 + [3.5] * 50 + [0.4] * 60):
        now_s = step * SCRAPE_S
        ready = [name for name, ready_s in pods if ready_s <= now_s]
        for name in ready:
            busy_s[name] += min(1, load * noise.uniform(0.85, 1.15) / len(ready)) * SCRAPE_S  # type: ignore[assignment]
            status = WorkerStatus(
                service=service,
                worker=f"{NAME}-{service}-5d9-{name}-7-cafe",
                model="",
                sent_ns=time.time_ns(),
                cameras=[],
                busy_s=busy_s[name],
            )
            site.monitors[0].fleet.worker_status(status, time.time_ns())
        site.pass_time(0, ["d0"])
        series.scrape(await site.text())
        wished = scaler.decide(series.value(query), len(pods), now_s)
        pods = [*pods[:wished], *((f"w{step}n{number}", now_s + START_S) for number in range(wished - len(pods)))]
        counts.append(wished)
    changes = [count for before, count in zip([0, *counts], counts, strict=False) if count != before]
    top = changes.index(max(changes))
    assert changes == [*sorted(changes[: top + 1]), *sorted(changes[top + 1 :], reverse=True)], counts
    assert (changes[0], changes[-1]) == (1, 1)
    assert 3.5 < max(changes) <= 6


def test_the_rules_are_prometheus_own_and_the_query_is_one_of_them(query: str) -> None:
    assert "9 rules found" in check_rules(RULES)
    groups = yaml.safe_load(RULES.read_text(encoding="utf-8"))["groups"]
    assert groups[0]["rules"][0]["expr"].strip() == query.strip()
    (rule,) = (each for each in render({"prometheusRule": {"enabled": True}}) if each["kind"] == "PrometheusRule")
    assert (rule["metadata"]["name"], rule["spec"]["groups"]) == (f"{NAME}-monitor", groups)


async def test_the_rules_name_what_there_is(site: Site) -> None:
    site.pass_time(80, ["w0"])
    there = set(re.findall(r"^(fleetsight_\w+)", await site.text(), re.MULTILINE))
    named = set(re.findall(r"(fleetsight_\w+)\{", RULES.read_text(encoding="utf-8")))
    assert named <= there
    assert {"fleetsight_camera_frames_beyond_use_total", "fleetsight_worker_busy_seconds_total"} <= named
    (reasons,) = set(re.findall(r'reason=~"([^"]+)"', RULES.read_text(encoding="utf-8")))
    assert set(reasons.split("|")) == {REPLACED, STALE} == set(TOO_MANY)
