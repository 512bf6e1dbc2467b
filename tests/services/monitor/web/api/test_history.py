"""Routes about the history."""

import csv
import io
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import polars as pl
import pytest
from msgspec.structs import replace

from schemas.alerts import AlertState
from schemas.keys import CameraKey
from services.monitor.history.archive import MAX_ROWS
from services.monitor.history.state import Act
from services.monitor.history.store import Store
from services.monitor.history.world_history import ObjectEvent
from services.monitor.web.api.paging import MAX_ITEMS
from services.monitor.web.auth.users import Role
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.web.api.seeing import ODD
from tests.services.monitor.web.api.test_alerts import alert
from tests.services.monitor.web.asking import Web, web_in

S = 10**9


@pytest.fixture
async def kept(tmp_path: Path) -> AsyncIterator[Web]:
    """One whose history has five intervals, one a second, the last of which goes on, and two alerts."""
    history = f"sqlite:///{tmp_path / 'history.db'}"
    store = await Store.open(history)
    some = [
        replace(interval(n, n, key=CameraKey(f"r{n % 2}", "front"), is_open=n == 4, name=ODD), until_ns=n * S + 1)
        for n in range(5)
    ]
    acts = [Act("a1", AlertState.ACKNOWLEDGED, "ann", 7), Act("a1", AlertState.RESOLVED, "bob", 8)]
    await store.write(some, [alert("a1", AlertState.RESOLVED), alert("a2")], 9 * S, acts)
    await store.close()
    async with web_in(tmp_path, history=history) as made:
        yield made
        await made.monitor.history._end()


async def test_sightings_newest_first_page_by_page(kept: Web) -> None:
    async with await kept.program() as program:
        asked = {"since": "1970-01-01T00:00:00Z", "limit": "2"}
        first = (await program.get("/api/v1/history/sightings", params=asked)).json()
        assert [each["since"] for each in first["items"]] == ["1970-01-01T00:00:04Z", "1970-01-01T00:00:03Z"]
        assert (first["items"][0]["open"], first["items"][0]["until"]) == (True, "1970-01-01T00:00:09Z")
        assert first["items"][0]["class"] == ODD
        second = (await program.get("/api/v1/history/sightings", params={**asked, "after": first["next"]})).json()
        third = (await program.get("/api/v1/history/sightings", params={**asked, "after": second["next"]})).json()
        assert [len(page["items"]) for page in (second, third)] == [2, 1]
        assert third["next"] is None


async def test_nothing_follows_a_page_that_ends_with_the_last_one(kept: Web) -> None:
    async with await kept.program() as program:
        for what, count in (("sightings", 5), ("alerts", 2)):
            for limit, more in ((count - 1, True), (count, False), (MAX_ITEMS, False)):
                asked = {"since": "1970-01-01T00:00:00Z", "limit": str(limit)}
                page = (await program.get(f"/api/v1/history/{what}", params=asked)).json()
                assert (len(page["items"]), page["next"] is not None) == (min(limit, count), more), (what, limit)


def test_the_longest_page_and_one_more_are_read_at_once() -> None:
    assert MAX_ITEMS + 1 <= MAX_ROWS


async def test_a_time_that_is_none_is_refused_with_how_one_is_written(kept: Web) -> None:
    async with await kept.program() as program:
        for wrong in ("yesterday", "2026-11-20T06:00"):
            answer = await program.get("/api/v1/history/sightings", params={"since": wrong})
            assert answer.json() == {"error": "since: write a time like 2026-11-20T06:00Z"}


async def test_a_time_and_a_robot_are_picked_out(kept: Web) -> None:
    async with await kept.program() as program:
        asked = {"since": "1970-01-01T01:00:02+01:00", "until": "1970-01-01T00:00:03Z", "robot": "r1"}
        found = (await program.get("/api/v1/history/sightings", params=asked)).json()
        assert [(each["robot"], each["since"]) for each in found["items"]] == [("r1", "1970-01-01T00:00:03Z")]
        assert (
            len((await program.get("/api/v1/history/sightings")).json()["items"]) == 1
        )  # only what goes on is of today


async def test_alerts_with_what_was_done(kept: Web) -> None:
    async with await kept.program() as program:
        (one,) = (await program.get("/api/v1/history/alerts?state=resolved")).json()["items"]
        assert (one["id"], [(act["state"], act["who"]) for act in one["acts"]]) == (
            "a1",
            [("acknowledged", "ann"), ("resolved", "bob")],
        )
        page = (await program.get("/api/v1/history/alerts?limit=1")).json()
        rest = (await program.get("/api/v1/history/alerts", params={"after": page["next"]})).json()
        assert [each["id"] for each in (*page["items"], *rest["items"])] == ["a2", "a1"]


async def test_all_of_it_as_a_file(kept: Web) -> None:
    async with await kept.program() as program:
        answer = await program.get("/api/v1/history/export", params={"since": "1970-01-01T00:00:00Z"})
        assert answer.headers["Content-Disposition"] == 'attachment; filename="sightings.csv"'
        rows = list(csv.DictReader(io.StringIO(answer.text)))
        assert [row["robot"] for row in rows] == ["r0", "r1", "r0", "r1", "r0"]
        alerts = await program.get("/api/v1/history/export?what=alerts")
        assert [row["id"] for row in csv.DictReader(io.StringIO(alerts.text))] == ["a1", "a2"]


async def test_a_file_for_excel_begins_with_a_byte_order_mark(kept: Web) -> None:
    async with await kept.program() as program:
        for query, begin in (("", b"robot"), ("?bom=true", b"\xef\xbb\xbfrobot")):
            assert (await program.get(f"/api/v1/history/export{query}")).content.startswith(begin)


async def test_an_operator_says_that_the_clock_is_right(kept: Web) -> None:
    kept.monitor.history._leads = True
    async with await kept.browser(Role.VIEWER) as viewer:
        assert (await viewer.post("/api/v1/history/trust-clock")).status_code == 403
    async with await kept.browser() as operator:
        assert (await operator.post("/api/v1/history/trust-clock")).status_code == 204
    assert kept.monitor.history._upkeep._is_trusted


async def test_without_a_history_that_is_said(web: Web) -> None:
    async with await web.program() as program:
        for path in ("sightings", "alerts", "export"):
            answer = await program.get(f"/api/v1/history/{path}")
            assert (answer.status_code, "--history none" in answer.json()["error"]) == (503, True)


async def test_a_database_that_is_gone_is_said(kept: Web, tmp_path: Path) -> None:
    (tmp_path / "history.db").write_bytes(b"no database" * 1_000)
    async with await kept.program() as program:
        for path in ("sightings", "alerts", "export"):
            answer = await program.get(f"/api/v1/history/{path}")
            assert (answer.status_code, answer.json()["error"]) == (
                503,
                f"the history cannot be read: {tmp_path}/history.db: file is not a database",
            )


async def test_history_is_downloaded_as_parquet(tmp_path: Path) -> None:
    history = f"sqlite:///{tmp_path / 'history.db'}"
    store = await Store.open(history)
    try:
        await store.write([interval(1, 2), interval(3, 4, name="pallet")], [], 9 * S)
    finally:
        await store.close()
    async with web_in(tmp_path, history=history) as web, await web.program() as program:
        asked = {"format": "parquet", "since": "1970-01-01T00:00:00Z"}
        answer = await program.get("/api/v1/history/export", params=asked)
        boxes = await program.get("/api/v1/history/export", params={**asked, "class": "box"})
        await web.monitor.history._end()
    assert answer.headers["Content-Disposition"] == 'attachment; filename="sightings.parquet"'
    assert answer.headers["Content-Type"] == "application/vnd.apache.parquet"
    frame = pl.read_parquet(io.BytesIO(answer.content))
    assert frame["class"].to_list() == ["box", "pallet"]
    assert frame["count"].to_list() == [2, 2]
    assert pl.read_parquet(io.BytesIO(boxes.content))["class"].to_list() == ["box"]


async def test_parquet_without_its_extra_is_refused_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polars", None)
    async with web_in(tmp_path, history=f"sqlite:///{tmp_path / 'history.db'}") as web, await web.program() as program:
        answer = await program.get("/api/v1/history/export?format=parquet")
        assert (answer.status_code, "install fleetsight[parquet]" in answer.json()["error"]) == (422, True)
        await web.monitor.history._end()


async def test_what_ends_before_it_begins_is_refused(web: Web) -> None:
    async with await web.program() as program:
        for what in ("sightings", "alerts", "export"):
            asked = {"since": "2026-11-21T00:00:00Z", "until": "2026-11-20T00:00:00Z"}
            answer = await program.get(f"/api/v1/history/{what}", params=asked)
            assert (answer.status_code, answer.json()["error"]) == (422, "since is later than until")
            answer = await program.get(f"/api/v1/history/{what}", params={"until": "1970-01-02T00:00:00Z"})
            assert (answer.status_code, answer.json()["error"]) == (422, "since, a day ago, is later than until")


async def test_the_description_says_what_files_an_export_is(web: Web) -> None:
    async with await web.program() as program:
        found = (await program.get("/api/openapi.json")).json()["paths"]["/api/v1/history/export"]["get"]
        assert set(found["responses"]["200"]["content"]) == {"text/csv", "application/vnd.apache.parquet"}


async def test_what_became_of_objects_comes_in_pages_newest_first(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with opened(url) as store:
        events = [
            ObjectEvent(
                since_ns=at_s * S,
                until_ns=at_s * S,
                open=False,
                site=site,
                object=name,
                kind="gone",
                name="box",
                x=1,
                y=2,
            )
            for at_s, site, name in ((10, "hall", "a"), (20, "hall", "b"), (30, "yard", "a"))
        ]
        await store.write(events)
    async with web_in(tmp_path, history=url) as web, await web.program() as program:
        first = (await program.get("/api/v1/history/events?since=0&limit=2")).json()
        assert [(each["site"], each["object"], each["kind"]) for each in first["items"]] == [
            ("yard", "a", "gone"),
            ("hall", "b", "gone"),
        ]
        rest = (await program.get("/api/v1/history/events", params={"since": 0, "after": first["next"]})).json()
        assert [(each["object"], each["class"], each["x"], each["since"]) for each in rest["items"]] == [
            ("a", "box", 1.0, "1970-01-01T00:00:10Z")
        ]
        one = (await program.get("/api/v1/history/events?since=0&site=hall&object=a&class=box")).json()
        assert len(one["items"]) == 1
        assert (await program.get("/api/v1/history/events")).json()["items"] == []
        assert (await program.get("/api/v1/history/events?robot=r1")).status_code == 422
