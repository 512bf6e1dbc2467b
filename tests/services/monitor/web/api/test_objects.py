"""The objects of sites over HTTP: pages, one, files, and what became of them."""

import csv
from io import BytesIO, StringIO
from time import time_ns

import msgspec
import polars as pl
import pytest

from schemas.world import Seer
from services.monitor.world.site_objects import World
from tests.services.monitor.web.asking import Web
from tests.services.monitor.world.test_site_objects import DOCK, tell_of, thing

S = 10**9


@pytest.fixture
def told(web: Web) -> Web:
    """Have two sites known; the model of `yard` is silent."""
    fleet, now_ns = web.monitor.fleet, time_ns()
    fleet.world = World([DOCK])
    seen_by = [Seer(robot="r1", camera="front", last_ns=now_ns), Seer(robot="r2", camera="rear", last_ns=1)]
    known = msgspec.structs.replace(thing("a", 1), last_ns=now_ns, seen_by=seen_by, yaw=0.5, velocity=(1.0, -2.0))
    tell_of(fleet, known, thing("b", 9), thing("=c", 2, name="pallet"))
    tell_of(fleet, thing("a", 1, name="drum"), site="yard", for_s=-60)
    return web


async def test_objects_come_in_pages_by_site_and_id(told: Web) -> None:
    async with await told.program() as program:
        first = (await program.get("/api/v1/objects?limit=3")).json()
        assert [(each["site"], each["id"], each["current"]) for each in first["items"]] == [
            ("hall", "=c", True),
            ("hall", "a", True),
            ("hall", "b", True),
        ]
        rest = (await program.get("/api/v1/objects", params={"limit": 3, "after": first["next"]})).json()
        assert [(each["site"], each["class"], each["current"]) for each in rest["items"]] == [("yard", "drum", False)]
        assert rest["next"] is None
        one = first["items"][1]
        assert (one["class"], one["zones"], one["yaw"], one["velocity"]) == ("box", ["dock"], 0.5, [1.0, -2.0])
        assert (one["x"], one["y"], one["z"], one["sigma_m"], one["length"]) == (1, 1, 0.5, 0.1, 1)
        assert [(each["robot"], each["camera"]) for each in one["seen_by"]] == [("r1", "front"), ("r2", "rear")]
        assert one["looked_in_vain"] is None


@pytest.mark.parametrize(
    ("query", "ids"),
    [
        ("site=yard", ["a"]),
        ("class=pallet", ["=c"]),
        ("site=hall&zone=dock", ["=c", "a"]),
        ("robot=r2", ["a"]),
        ("seen_within_s=60", ["a"]),
        ("unseen_for_s=60&site=hall", ["=c", "b"]),
        ("site=nowhere", []),
    ],
)
async def test_they_are_chosen_by_site_class_zone_robot_and_age(told: Web, query: str, ids: list[str]) -> None:
    async with await told.program() as program:
        items = (await program.get(f"/api/v1/objects?{query}")).json()["items"]
        assert [each["id"] for each in items] == ids
        text = (await program.get(f"/api/v1/objects/export?{query}")).text
        assert [row["id"].removeprefix("'") for row in csv.DictReader(StringIO(text))] == ids


async def test_one_object_is_answered_or_why_there_is_none(told: Web) -> None:
    async with await told.program() as program:
        assert (await program.get("/api/v1/objects/yard/a")).json()["class"] == "drum"
        for path, said in (("hall/zz", "no object 'zz' in site hall"), ("nowhere/a", "no site 'nowhere'")):
            answer = await program.get(f"/api/v1/objects/{path}")
            assert answer.status_code == 404
            assert said in answer.json()["error"]
        for query, said in (("clas=box", "unknown parameter 'clas'"), ("seen_within_s=-1", "seen_within_s")):
            answer = await program.get(f"/api/v1/objects?{query}")
            assert answer.status_code == 422
            assert said in answer.json()["error"]
    async with told.stranger() as stranger:
        assert (await stranger.get("/api/v1/objects")).status_code == 401


async def test_files_have_all_of_it_and_formulas_are_text(told: Web) -> None:
    async with await told.program() as program:
        answer = await program.get("/api/v1/objects/export?bom=true")
        assert answer.headers["content-type"].startswith("text/csv")
        assert 'filename="objects.csv"' in answer.headers["content-disposition"]
        rows = list(csv.DictReader(StringIO(answer.content.decode("utf-8-sig"))))
        assert [row["id"] for row in rows] == ["'=c", "a", "b", "a"]
        one = rows[1]
        assert (one["robot"], one["velocity_y"], one["zones"], one["current"]) == ("r1", "-2.0", "dock", "True")
        assert one["last_seen"].endswith("+00:00")
        found = pl.read_parquet(BytesIO((await program.get("/api/v1/objects/export?format=parquet")).content))
        assert found["id"].to_list() == ["=c", "a", "b", "a"]
        assert found.schema["last_seen"] == pl.Datetime("us", "UTC")
        assert found["yaw"].to_list() == [None, 0.5, None, None]
