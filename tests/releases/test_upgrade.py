"""An upgrade from each recorded release, and the way back: messages both ways, and the monitor's database.

`python -m tests.releases.record` records a release. Whether a reader of it takes what today's code writes is judged by
its JSON Schema here, and by its own code in test_side_by_side.py.
"""

import asyncio
import base64
import csv
import json
import re
import tomllib
from contextlib import suppress
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any, Final

import jsonschema
import msgspec
import pytest
from sqlalchemy import Connection, inspect

from deploy.release import is_released
from schemas import codec
from services.monitor.history.engine import engine_of
from services.monitor.history.export import run
from services.monitor.history.opening import connect
from services.monitor.history.settings import ExportSettings
from services.monitor.web.auth.passwords import Passwords
from services.monitor.web.auth.store import UserStore, users_url
from services.worldmodel.model import SiteModel
from services.worldmodel.state import restored
from tests.releases.record import (
    FOLDER,
    PASSWORD,
    ROWS,
    SITE,
    THINGS,
    USER,
    load_postgresql,
    load_sqlite,
    plain,
    world_state,
)
from tests.schemas.test_codec import MESSAGES
from tests.services.monitor.history.support.filling import STATEMENTS
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.history.test_store import every, interval, opened
from tests.services.monitor.inventory.seeing import S
from tests.services.worldmodel.scene import Camera, known, watch

ROOT: Final = Path(__file__).parents[2]
RELEASES: Final = sorted(path.parent for path in FOLDER.glob("*/messages.json"))
SCHEMAS: Final = {schema.__name__: schema for schema in codec.MAX_BYTES}
EXPORTED: Final = ("sightings", "alerts", "stock", "events")

numbers = count()


def recorded(release: Path) -> list[dict[str, str]]:
    found: list[dict[str, str]] = json.loads((release / "messages.json").read_text(encoding="utf-8"))
    return found


def reader(release: Path, schema: str) -> Any:
    """Return what a reader of the release demands of a message."""
    whole = json.loads((release / "messages.schema.json").read_text(encoding="utf-8"))
    return jsonschema.Draft202012Validator({"$ref": f"#/$defs/{schema}", "$defs": whole["$defs"]})


def lost(before: Any, after: Any, at: str = "") -> list[str]:
    """Return where something that was in a message is not, or is otherwise. New fields may be there."""
    if isinstance(before, dict) and isinstance(after, dict):
        return [each for key, value in before.items() for each in lost(value, after.get(key), f"{at}.{key}")]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        return [
            each
            for n, (old, new) in enumerate(zip(before, after, strict=True))
            for each in lost(old, new, f"{at}[{n}]")
        ]
    return [] if before == after else [f"{at}: {before!r}, now {after!r}"]


def test_the_last_two_releases_are_recorded_with_their_code() -> None:
    told = re.findall(r"^## \[?(\d[\w.]*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert told
    assert {each.name for each in RELEASES} >= set(told[:2])
    assert all([*release.glob(f"fleetsight-{release.name}-*.whl")] for release in RELEASES)


def test_the_record_of_a_version_that_is_not_released_yet_is_of_todays_messages() -> None:
    """Else it is recorded anew: python -m tests.releases.record."""
    told = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    today = json.loads((ROOT / "docs" / "messages.schema.json").read_text(encoding="utf-8"))
    for release in RELEASES:
        if release.name == version and not is_released(version, told):
            assert json.loads((release / "messages.schema.json").read_text(encoding="utf-8")) == today


@pytest.mark.parametrize("release", RELEASES, ids=lambda release: release.name)
class TestMessages:
    def test_a_message_of_every_type_was_recorded(self, release: Path) -> None:
        defined = json.loads((release / "messages.schema.json").read_text(encoding="utf-8"))["$defs"]
        assert {each["schema"] for each in recorded(release)} == {
            name for name, part in defined.items() if "zenohEncoding" in part
        }

    def test_today_every_message_of_it_is_read_with_all_that_it_says(self, release: Path) -> None:
        for each in recorded(release):
            payload = base64.b64decode(each["payload"])
            message: codec.Message = codec.decode(SCHEMAS[each["schema"]], payload, each["encoding"])
            assert lost(plain(payload), plain(codec.encode(message)), each["schema"]) == []

    @pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
    def test_its_readers_take_what_is_written_today(self, release: Path, message: codec.Message) -> None:
        known = {each["schema"]: each["encoding"] for each in recorded(release)}
        name = type(message).__name__
        if name in known:  # a type that is new is no reader's of before
            assert codec.encoding(type(message)) == known[name]
            reader(release, name).validate(plain(codec.encode(message)))

    def test_its_readers_take_fields_that_are_new_and_no_other_values(self, release: Path) -> None:
        recorded_alert = next(each for each in recorded(release) if each["schema"] == "Alert")
        fields = plain(base64.b64decode(recorded_alert["payload"]))
        alerts = reader(release, "Alert")
        alerts.validate({**fields, "colour": "red"})
        for spoilt in ({**fields, "severity": "dreadful"}, {**fields, "rule": 7}):
            with pytest.raises(jsonschema.ValidationError):
                alerts.validate(spoilt)


def test_what_is_lost_is_told() -> None:
    before = {"a": [1, {"b": 2.5}], "c": "x"}
    assert lost(before, {**deepcopy(before), "new": 1}) == []
    assert lost(before, {"a": [1, {"b": 2}]}) == [".a[1].b: 2.5, now 2", ".c: 'x', now None"]


@pytest.fixture(params=["sqlite", "postgresql"])
def kind(request: pytest.FixtureRequest) -> str:
    """Either kind of database."""
    return str(request.param)


@pytest.fixture
def empty(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """An empty database."""
    if kind == "sqlite":
        return f"sqlite:///{tmp_path}/empty.db"
    server: PostgreSQL = request.getfixturevalue("postgresql")
    return server.create(f"empty_{next(numbers)}")


@pytest.fixture
def history(release: Path, kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """A database that a monitor of the release left."""
    text = (release / f"history.{kind}.sql").read_text(encoding="utf-8")
    if kind == "sqlite":
        return load_sqlite(text, tmp_path / "history.db")
    return load_postgresql(text, request.getfixturevalue("postgresql"), f"release_{next(numbers)}")


def described(connection: Connection) -> dict[str, Any]:
    """Return each table's columns (names, types, whether they may be empty), keys, constraints and indexes."""
    there = inspect(connection)
    return {
        table: {
            "columns": [(each["name"], str(each["type"]), each["nullable"]) for each in there.get_columns(table)],
            "key": there.get_pk_constraint(table)["constrained_columns"],
            "foreign": sorted(
                (each["constrained_columns"], each["referred_table"]) for each in there.get_foreign_keys(table)
            ),
            "unique": sorted(each["column_names"] for each in there.get_unique_constraints(table)),
            "checks": sorted(each["sqltext"] for each in there.get_check_constraints(table)),
            "indexes": sorted((each["column_names"], each["unique"]) for each in there.get_indexes(table)),
        }
        for table in there.get_table_names()
        if not table.startswith("sqlite_")
    }


async def tables(url: str) -> dict[str, Any]:
    engine = engine_of(url)
    connection = await connect(engine, create=True)
    try:
        return await connection.run_sync(described)
    finally:
        await connection.close()
        await engine.dispose()


@pytest.mark.parametrize("release", RELEASES, ids=lambda release: release.name)
class TestHistory:
    async def test_all_that_it_kept_is_there(self, history: str, tmp_path: Path) -> None:
        async with opened(history) as store:
            state = await store.load(0)
            assert (await store.heartbeat_ns(), len(state.alerts)) == (1_764_100_000 * S, 1)
            assert len(await store.poses(0)) == len(await store.forgotten()) == ROWS
        for what in EXPORTED:
            file = tmp_path / f"{what}.csv"
            await run(ExportSettings.model_validate({"task": "export", "history": history, "to": file, "what": what}))
            rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
            assert len(rows) == ROWS, what
            assert all(any(row.values()) for row in rows)

    async def test_its_users_log_in_with_their_passwords(self, history: str) -> None:
        (user,) = await UserStore(users_url(history), create=False).users()
        assert (user.name, user.role) == (USER, "operator")
        assert await Passwords().check(user.password, PASSWORD)
        assert not await Passwords().check(user.password, f"{PASSWORD}s")

    async def test_it_is_copied_while_a_monitor_of_today_writes_and_restored(
        self, history: str, empty: str, tmp_path: Path
    ) -> None:
        async with opened(history) as store:
            before = await every(store)

            written = asyncio.Event()

            async def write() -> None:
                for at in range(10_000):
                    await store.write([interval(at, at + 1, name="new")], [], 1_764_200_000 * S)
                    written.set()

            writing = asyncio.create_task(write())
            try:
                await written.wait()
                await run(ExportSettings(task="backup", history=history, to=tmp_path / "copy"))
                assert not writing.done()
            finally:
                writing.cancel()
                with suppress(asyncio.CancelledError):
                    await writing
        await run(ExportSettings.model_validate({"task": "restore", "history": empty, "from": tmp_path / "copy"}))
        async with opened(empty) as store:
            found = await every(store)
        assert len(before) == ROWS
        assert [each for each in found if each.name != "new"] == before
        assert len(found) > ROWS

    async def test_going_back_it_has_the_tables_that_it_writes_to(self, history: str, empty: str) -> None:
        engine = engine_of(history)
        async with engine.connect() as connection:
            theirs = await connection.run_sync(described)
        await engine.dispose()
        assert STATEMENTS.keys() < theirs.keys()
        for today in (await tables(history), await tables(empty)):  # an upgraded one, and one that was made today
            assert {name: today.get(name) for name in theirs} == theirs


@pytest.mark.parametrize("release", RELEASES, ids=lambda release: release.name)
class TestWorld:
    def test_a_model_goes_on_from_what_it_kept(self, release: Path) -> None:
        model = SiteModel()
        assert restored(SITE, (release / "world.state").read_bytes(), model) == ("a1", 7)
        found = known(model)
        assert [each.name for each in found] == [each.name for each in THINGS]
        for thing, each in zip(THINGS, found, strict=True):
            assert (each.x, each.y) == pytest.approx((thing.x, thing.y), abs=0.2)
        assert watch(model, THINGS, [Camera(robot="r1")], 6.0, 4) == []  # nothing appeared, moved or is gone

    def test_going_back_the_state_has_all_that_was_in_it(self, release: Path) -> None:
        before, now = map(msgspec.msgpack.decode, ((release / "world.state").read_bytes(), world_state()))
        assert (now.keys() >= before.keys(), now["version"]) == (True, before["version"])
        assert {name: now["columns"][name][0] for name in before["columns"]} == {
            name: kind for name, (kind, _) in before["columns"].items()
        }
