import asyncio
import hashlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from sqlalchemy import inspect, select, text, update
from sqlalchemy.ext.asyncio import AsyncConnection

from bus.fake import FakeNetwork
from services.monitor.fleet import Fleet
from services.monitor.history.engine import engine_of, file_of
from services.monitor.history.export import export
from services.monitor.history.opening import connect
from services.monitor.history.settings import ExportSettings
from services.monitor.history.state import HistoryError, OtherVersionError
from services.monitor.history.store import Store
from services.monitor.history.tables import SCHEMA_VERSION, metadata, schema_version
from services.monitor.process import run, running
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.store import UserStore, users_url
from tests.services.monitor.history.support.monitoring import monitoring
from tests.services.monitor.history.test_store import every, interval, opened
from tests.services.monitor.inventory.seeing import S
from tests.waiting import until


@asynccontextmanager
async def changing(url: str) -> AsyncIterator[AsyncConnection]:
    """Change a database behind our back."""
    engine = engine_of(url)
    try:
        async with engine.begin() as connection:
            if engine.dialect.name == "postgresql":  # in a deadlock, somebody else gives way
                await connection.execute(text("SET LOCAL deadlock_timeout = '1min'"))
            yield connection
    finally:
        await engine.dispose()


async def made(url: str, number: int = SCHEMA_VERSION) -> None:
    """Make a database with one interval; it says that its tables are of this version."""
    async with opened(url) as store:
        await store.write([interval(1, 2)], [], 9 * S)
    async with changing(url) as connection:
        await connection.execute(update(schema_version).values(number=number))


async def unnumbered(url: str, then: str = "") -> None:
    """Make a database as it was before there were versions."""
    await made(url)
    async with changing(url) as connection:
        await connection.execute(text("DROP TABLE schema_version"))
        if then:
            await connection.execute(text(then))


async def numbers(url: str) -> list[int]:
    async with changing(url) as connection:
        return list(await connection.scalars(select(schema_version.c.number)))


@pytest.mark.parametrize(("number", "age"), [(SCHEMA_VERSION + 1, "newer"), (SCHEMA_VERSION - 1, "older")])
async def test_a_database_of_another_version_is_refused_by_all_who_open_it(
    url: str, number: int, age: str, tmp_path: Path
) -> None:
    await made(url, number)
    said = f"{age}: its tables are version {number}, this one's are version {SCHEMA_VERSION}$"
    with pytest.raises(OtherVersionError, match=said):
        await Store.open(url)
    with pytest.raises(OtherVersionError, match=said):
        await UserStore(url).users()
    with pytest.raises(OtherVersionError, match=said):
        await export(ExportSettings(task="export", history=url, to=tmp_path / "seen.csv"))
    assert await numbers(url) == [number]


async def test_a_monitor_does_not_begin_with_a_database_of_another_version(url: str) -> None:
    await made(url, SCHEMA_VERSION + 1)
    async with FakeNetwork().open_bus() as bus:
        with pytest.raises(OtherVersionError, match="newer"):
            async with running(MonitorSettings(history=url), bus, Fleet("clock")):
                pass


async def test_nor_with_users_of_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    await made(users_url("none"), SCHEMA_VERSION + 1)
    with pytest.raises(OtherVersionError, match=r"users\.db: .*newer"):
        await run(MonitorSettings(history="none", web_port=0))


async def test_a_database_that_becomes_another_versions_ends_no_monitor(url: str) -> None:
    async with monitoring(url) as monitor:
        await until(monitor.written)
        async with changing(url) as connection:
            await connection.execute(text("ALTER TABLE heartbeat DROP COLUMN at_ns"))
            await connection.execute(update(schema_version).values(number=SCHEMA_VERSION + 1))
        await until(lambda: "newer" in monitor.history.status.problem)


async def test_a_database_without_a_version_and_with_the_right_tables_is_gone_on_with(url: str) -> None:
    await unnumbered(url, "DROP TABLE presence")
    async with opened(url) as store:
        assert await every(store) == [interval(1, 2)]
    assert await numbers(url) == [SCHEMA_VERSION]


@pytest.mark.parametrize("create", [True, False])
async def test_a_database_without_a_version_and_with_other_tables_is_refused(url: str, create: bool) -> None:  # noqa: FBT001 - a parameter
    await unnumbered(url, "ALTER TABLE intervals DROP COLUMN score")
    with pytest.raises(OtherVersionError, match=r"older.*its table intervals has other columns"):
        await Store.open(url, create=create)


async def test_a_table_that_came_later_is_made_where_it_is_missing(url: str) -> None:
    await made(url)
    async with changing(url) as connection:
        await connection.execute(text("DROP TABLE forgotten"))
    reading = await Store.open(url, create=False)
    await reading.close()
    stores = await asyncio.gather(*(Store.open(url) for _ in range(8)))
    await stores[0].forget({"r1": 5})
    assert [await store.forgotten() for store in stores] == [{"r1": 5}] * len(stores)
    for store in stores:
        await store.close()
    assert await numbers(url) == [SCHEMA_VERSION]


async def test_several_that_open_an_empty_database_at_once_all_have_it(url: str) -> None:
    stores = await asyncio.gather(*(Store.open(url) for _ in range(24)))
    for store in stores:
        await store.close()
    assert await numbers(url) == [SCHEMA_VERSION]


async def test_one_that_only_reads_changes_nothing(url: str) -> None:
    await unnumbered(url)
    store = await Store.open(url, create=False)
    try:
        assert await every(store) == [interval(1, 2)]
    finally:
        await store.close()
    async with changing(url) as connection:
        assert not await connection.run_sync(lambda of: inspect(of).has_table(schema_version.name))


async def test_nothing_is_made_for_one_that_only_reads(url: str) -> None:
    file = file_of(engine_of(url))
    with pytest.raises(HistoryError, match="does not exist" if file else "no monitor has kept anything there"):
        await Store.open(url, create=False)
    if file is None:
        async with changing(url) as connection:
            assert await connection.run_sync(lambda of: inspect(of).get_table_names()) == []
    else:
        assert not file.parent.exists()


async def test_a_file_without_tables_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "empty.db").touch()
    engine = engine_of(f"sqlite:///{tmp_path}/empty.db")
    with pytest.raises(HistoryError, match=r"empty\.db: no monitor has kept anything there"):
        await connect(engine, create=False)
    async with changing(f"sqlite:///{tmp_path}/empty.db") as connection:
        assert await connection.run_sync(lambda of: inspect(of).get_table_names()) == []


async def test_what_cannot_be_had_is_named_without_its_password() -> None:
    with pytest.raises(HistoryError, match=r"^postgresql://ann:\*\*\*@127\.0\.0\.1:1/fleet: .*Connect") as raised:
        await Store.open("postgresql://ann:secret@127.0.0.1:1/fleet?password=secret")
    assert "secret" not in str(raised.value)


def test_tables_that_change_get_another_version() -> None:
    columns = [
        (table.name, column.name, str(column.type), column.nullable, column.primary_key)
        for table in metadata.sorted_tables
        for column in table.columns
    ]
    digest = hashlib.sha256(repr(sorted(columns)).encode()).hexdigest()[:16]
    assert (SCHEMA_VERSION, digest) == (1, "41f2f7ec3da275b0"), (
        "raise SCHEMA_VERSION, but for a new table; write both here"
    )
