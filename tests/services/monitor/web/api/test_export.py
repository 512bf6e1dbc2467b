import io
import sys
from pathlib import Path

import polars as pl
import pytest

from services.monitor.history.store import Store
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.web.asking import Web, web_in


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
