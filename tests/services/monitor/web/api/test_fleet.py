"""Routes about the current fleet."""

import asyncio
import json
import time
from typing import Any

import httpx
import msgspec
import pytest
import websockets

from bus.fake import FakeNetwork
from schemas.keys import CameraKey
from schemas.world import RobotOffset
from services.monitor.event_loop import cooperative_yielding
from services.monitor.inventory.inventory import Inventory
from services.monitor.web.api.fleet import SightingKey, SightingQuery, some_entries
from services.monitor.web.api.live import UNLESS_CHOSEN
from services.monitor.web.auth.users import Role
from services.monitor.world.site_objects import World
from tests.services.monitor.inventory.seeing import S, seen
from tests.services.monitor.web.api.seeing import ODD, fill
from tests.services.monitor.web.api.test_alerts import alert, raise_alert
from tests.services.monitor.web.asking import Web
from tests.services.monitor.web.serving import monitor_on, served
from tests.services.monitor.world.test_site_objects import DOCK, RACK, thing
from tests.services.monitor.world.test_site_status import status as site_status


async def test_the_fleet_as_it_is(web: Web) -> None:
    fill(web.monitor.fleet)
    async with await web.program() as program:
        robots = (await program.get("/api/v1/robots")).json()["items"]
        assert [(each["name"], each["online"], each["cameras"]) for each in robots] == [
            ("r1", True, ["front"]),
            ("r2", False, ["front"]),
        ]
        assert robots[0]["problems"] == [f"waits for {ODD}"]
        assert robots[0]["dropped"] == {f"gateway: {ODD}": 4, "gateway: w": 1, "detector/w1: late": 2}
        assert (robots[0]["last_seen"][-1], robots[1]["last_seen"], robots[1]["age_s"]) == ("Z", None, None)
        (camera,) = (await program.get("/api/v1/cameras?robot=r1")).json()["items"]
        assert camera["classes"] == [{"name": ODD, "count": 2, "score": 0.5}]
        assert (camera["stale"], camera["age_exact"], camera["served_by"]) == (False, True, ["detector/w1"])
        (seen,) = (await program.get("/api/v1/inventory", params={"class": ODD, "in_view": True})).json()["items"]
        assert (seen["class"], seen["count"], seen["available"], seen["worker"]) == (ODD, 2, True, "w")
        (gateway,) = (await program.get("/api/v1/gateways")).json()["items"]
        assert (gateway["streams"][0]["topic"], gateway["withdrawn"], gateway["version"]) == (ODD, {"w": 1}, ODD)
        (worker,) = (await program.get("/api/v1/workers?service=detector")).json()["items"]
        assert (worker["model"], worker["online"], worker["version"]) == (ODD, True, "0.9")
        assert worker["runtime"] == "openvino-int8"
        assert worker["cameras"][0]["dropped"] == {"late": 2}


async def test_a_robot_that_is_gone_is_forgotten_by_an_operator_and_its_alerts_are_resolved(web: Web) -> None:
    fill(web.monitor.fleet)
    gateway = msgspec.structs.replace(web.monitor.fleet.gateways["r1"], robot="r2")
    web.monitor.fleet.gateway_status(gateway, gateway.sent_ns)
    about = msgspec.structs.replace(alert(), robot="r2")
    raise_alert(web.monitor, about, alert("a2"))
    async with await web.browser(Role.VIEWER) as viewer:
        assert (await viewer.post("/api/v1/robots/r2/forget")).status_code == 403
    async with await web.browser() as browser:
        assert (await browser.post("/api/v1/robots/r2/forget")).status_code == 204
        assert [each["name"] for each in (await browser.get("/api/v1/robots")).json()["items"]] == ["r1"]
        assert [each["robot"] for each in (await browser.get("/api/v1/cameras")).json()["items"]] == ["r1"]
        for path in ("robots", "cameras?robot=r2", "gateways?robot=r2", "inventory?robot=r2"):
            items = (await browser.get(f"/api/v1/{path}")).json()["items"]
            assert "r2" not in [each.get("robot", each.get("name")) for each in items], path
        assert [each["id"] for each in (await browser.get("/api/v1/alerts")).json()["items"]] == ["a2"]
        assert [act.who for act in web.monitor.acts_of(about.id)] == ["operator"]
        for robot, status, error in (
            ("r1", 409, "the gateway of r1 is there: stop it first"),
            ("r2", 404, "no robot 'r2'"),
            ("r3", 404, "no robot 'r3'"),
        ):
            answer = await browser.post(f"/api/v1/robots/{robot}/forget")
            assert (answer.status_code, answer.json()) == (status, {"error": error})
        web.monitor.fleet.robot_presence("r2", alive=True)
        assert [each["name"] for each in (await browser.get("/api/v1/robots")).json()["items"]] == ["r1", "r2"]


async def test_sites_have_each_object_once_and_say_whether_they_are_current(web: Web) -> None:
    offset = RobotOffset(robot="r1", x=0.05, y=0.0, yaw=0.01, sigma_m=0.02, doubted="jumped", views=3, last_ns=1)
    now_ns = time.time_ns()
    hall = msgspec.structs.replace(site_status("hall", box=2), robots=[offset], problems=["r1: jumped"])
    web.monitor.fleet.sites.take(hall, now_ns)
    web.monitor.fleet.sites.take(site_status("yard", pallet=1), now_ns - 60 * 1_000_000_000)
    async with await web.program() as program:
        first, second = (await program.get("/api/v1/sites")).json()["items"]
        assert (first["site"], first["objects"], first["current"]) == ("hall", {"box": 2}, True)
        assert (first["robots"][0]["robot"], first["robots"][0]["doubted"]) == ("r1", "jumped")
        assert first["problems"] == ["r1: jumped"]
        assert (second["site"], second["current"]) == ("yard", False)
        metrics = (await program.get("/metrics")).text
    assert 'fleetsight_site_objects{class="box",site="hall"} 2.0' in metrics
    assert 'fleetsight_site_doubted_robots{site="hall"} 1.0' in metrics
    assert 'site="yard"' not in metrics


async def test_zones_have_the_objects_in_them_and_say_whether_they_are_current(web: Web) -> None:
    fleet = web.monitor.fleet
    yard = DOCK.model_copy(update={"site": "yard"})
    fleet.world = World([yard, RACK, DOCK])
    for site in ("hall", "yard"):
        fleet.sites.take(site_status(site), time.time_ns())
    fleet.world.sites["hall"].replace("e", 0, [thing("a", 1), thing("b", 2), thing("p", 7, name="pallet")])
    async with await web.program() as program:
        items = (await program.get("/api/v1/zones")).json()["items"]
        assert [(each["site"], each["name"], each["current"], each["objects"]) for each in items] == [
            ("hall", "dock", True, {"box": 2}),
            ("hall", "rack", True, {"pallet": 1}),
            ("yard", "dock", False, {}),
        ]
        assert items[0]["corners"] == [[0, 0], [4, 0], [4, 4], [0, 4]]
        page = (await program.get("/api/v1/zones?site=hall&limit=1")).json()
        assert [each["name"] for each in page["items"]] == ["dock"]
        rest = (await program.get("/api/v1/zones", params={"site": "hall", "after": page["next"]})).json()
        assert [each["name"] for each in rest["items"]] == ["rack"]
        fleet.world.sites["hall"].replace("e", 1, [thing("a", 1)])
        metrics = (await program.get("/metrics")).text
    assert 'fleetsight_zone_objects{class="box",site="hall",zone="dock"} 1.0' in metrics
    assert 'fleetsight_zone_objects{class="pallet",site="hall",zone="rack"} 0.0' in metrics
    assert 'site="yard",zone' not in metrics


async def test_filters_leave_out_the_rest(web: Web) -> None:
    fill(web.monitor.fleet)
    async with await web.program() as program:
        for path, names in {
            "robots?online=true": ["r1"],
            "robots?online=false": ["r2"],
            "cameras?online=false": ["r2"],
            "inventory?robot=r2": [],
            "inventory?camera=rear": [],
            "inventory?class=box": [],
            "inventory?available=false": [],
            "gateways?robot=r2": [],
            "workers?service=cloud": [],
        }.items():
            items = (await program.get(f"/api/v1/{path}")).json()["items"]
            assert [each.get("name", each.get("robot")) for each in items] == names, path


async def test_pages_are_whole_together(web: Web) -> None:
    for number in range(5):
        web.monitor.fleet.robot_presence(f"r{number}", alive=True)
    async with await web.program() as program:
        found: list[list[str]] = []
        after: dict[str, str] = {}
        while True:
            page = (await program.get("/api/v1/robots", params={"limit": 2, **after})).json()
            found.append([each["name"] for each in page["items"]])
            if page["next"] is None:
                break
            after = {"after": page["next"]}
        assert found == [["r0", "r1"], ["r2", "r3"], ["r4"]]


@pytest.mark.parametrize("what", ["robots", "cameras", "inventory", "gateways", "workers"])
async def test_others_get_their_turn_while_a_list_is_made(web: Web, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    fill(web.monitor.fleet)
    paused: list[str] = []

    async def pause() -> None:
        paused.append(what)

    monkeypatch.setattr(cooperative_yielding, "TURN_S", 0.0)
    monkeypatch.setattr(cooperative_yielding, "pause", pause)
    async with await web.program() as program:
        items = (await program.get(f"/api/v1/{what}")).json()["items"]
    assert len(paused) >= len(items) > 0


async def test_every_parameter_is_bounded_and_every_error_is_one_line(web: Web) -> None:
    async with await web.program() as program:
        for query in (
            "robots?limit=0",
            "robots?limit=1001",
            "robots?limit=x",
            "robots?after=!",
            "robots?after=WzFd",
            "robots?after=" + "x" * 1_001,
            "robots?online=perhaps",
            "cameras?robot=" + "x" * 65,
            "inventory?class=" + "x" * 257,
            "history/sightings?after=WzEsMiwzLDRd",
            "history/sightings?since=yesterday",
            "history/sightings?since=2026-11-20T06:00:00",
            "history/alerts?state=odd",
            "history/export?format=exe",
        ):
            answer = await program.get(f"/api/v1/{query}")
            assert (answer.status_code, list(answer.json())) == (422, ["error"]), query
            assert "\n" not in answer.json()["error"]
        missing = await program.get("/api/v1/what")
        assert (missing.status_code, missing.json()) == (404, {"error": "there is no /api/v1/what"})


async def test_the_document_says_what_there_is(web: Web) -> None:
    async with await web.program() as program:
        document = (await program.get("/api/openapi.json")).json()
        assert {"/api/v1/robots", "/api/v1/alerts/{alert_id}/acknowledge", "/api/v1/history/export"} <= set(
            document["paths"]
        )
        for path, item in (("robots", "RobotAnswer"), ("cameras", "CameraAnswer"), ("inventory", "SightingAnswer")):
            answer = document["paths"][f"/api/v1/{path}"]["get"]["responses"]["200"]["content"]["application/json"]
            assert answer["schema"]["$ref"].endswith(f"/Page_{item}_")
        assert "class" in document["components"]["schemas"]["SightingAnswer"]["properties"]
        for gone in ("/docs", "/redoc", "/openapi.json"):
            assert (await program.get(gone)).status_code == 404


def stocked(robots: int = 3) -> Inventory:
    """Return robots with two cameras each that see two classes; of r0's front camera the pallet went."""
    inventory = Inventory()
    for number in range(robots):
        for camera in ("front", "rear"):
            key = CameraKey(f"r{number}", camera)
            inventory.robot_presence(key.robot, alive=number != 1)
            inventory.camera_presence(key, alive=True)
            for seq in (1, 2):
                inventory.see(seen(seq, {"pallet": 1, "box": 2}, key=key), seq)
    for seq in (3, 4, 5):
        inventory.see(seen(seq, {"box": 2}, key=CameraKey("r0", "front")), seq * S)
    return inventory


async def places(asked: SightingQuery, most: int = 100, *, robots: int = 3) -> list[SightingKey]:
    found = await some_entries(stocked(robots), asked, most, 2)
    return [(each.sighting.key.robot, each.sighting.key.camera, each.sighting.name) for each in found]


async def test_all_of_it_is_what_the_inventory_lists() -> None:
    inventory = stocked()
    assert await some_entries(inventory, SightingQuery(), 100, 2) == list(inventory.entries(2))


async def test_pages_go_on_behind_what_was_the_last_wherever_that_was() -> None:
    every = await places(SightingQuery())
    assert len(every) == 12
    for number, place in enumerate(every):
        assert await places(SightingQuery(after=place), 4) == every[number + 1 : number + 5]
    assert await places(SightingQuery(after=("r0", "front", "crate")), 1) == [("r0", "front", "pallet")]
    assert await places(SightingQuery(after=("r0", "middle", "")), 1) == [("r0", "rear", "box")]
    assert await places(SightingQuery(robot="r1", after=("r0", "front", "box")), 1) == [("r1", "front", "box")]


async def test_only_what_is_asked_for() -> None:
    assert {robot for robot, _, _ in await places(SightingQuery(robot="r1"))} == {"r1"}
    assert {camera for _, camera, _ in await places(SightingQuery(camera="rear"))} == {"rear"}
    assert len(await places(SightingQuery(name="pallet"))) == 6
    assert len(await places(SightingQuery(name="pallet", in_view=True))) == 5
    assert {robot for robot, _, _ in await places(SightingQuery(available=False))} == {"r1"}
    assert {robot for robot, _, _ in await places(SightingQuery(available=True))} == {"r0", "r2"}


async def test_what_takes_many_turns_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cooperative_yielding, "TURN_S", 0.0)
    assert len(await places(SightingQuery(name="box"), 1_000, robots=20)) == 40


MOVING = {"age_s", "rate_hz"}
"""What differs from one moment to the next."""


def still(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(({name: item[name] for name in item if name not in MOVING} for item in items), key=json.dumps)


async def test_an_item_is_the_same_on_the_socket_and_in_the_answer() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        fill(monitor.fleet)
        raise_alert(monitor, alert())
        async with served(monitor) as at:
            token = {"Authorization": f"Bearer {at.token}"}
            where = f"ws{at.url.removeprefix('http')}/api/v1/live"
            async with httpx.AsyncClient(base_url=at.url, headers=token, timeout=20) as program:

                async def ask() -> dict[str, Any]:
                    answers = {topic: await program.get(f"/api/v1/{topic}") for topic in UNLESS_CHOSEN}
                    return {topic: still(answer.json()["items"]) for topic, answer in answers.items()}

                before, answered, brought = None, await ask(), {}
                while before != answered:  # what was heard of becomes stale meanwhile
                    async with websockets.connect(where, additional_headers=token) as socket, asyncio.timeout(20):
                        brought = json.loads(await socket.recv())
                    before, answered = answered, await ask()
    assert {topic for topic, items in answered.items() if not items} == {"sites", "zones", "warehouses"}
    assert set(brought) == {"now", *UNLESS_CHOSEN}
    assert {topic: still(brought[topic]["changed"]) for topic in UNLESS_CHOSEN} == answered
