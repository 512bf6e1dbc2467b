"""Records what this release writes, for later ones to be tried with: `python -m tests.releases.record`.

Makes tests/releases/VERSION with a message of every type, the schema by which this release reads messages, a history
of either database as SQL, a world model's state, and the release's own code. Once a version is released, its record
stays as it is.
"""

import asyncio
import base64
import json
import shutil
import sqlite3
import subprocess
import sys
import tomllib
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from zipfile import ZIP_DEFLATED, ZipFile

import msgspec

from schemas import codec
from schemas.json_schema import json_schema
from services.monitor.history.store import Store
from services.monitor.web.auth.passwords import Passwords
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.auth.users import Role, User
from services.worldmodel.model import SiteModel
from services.worldmodel.state import saved
from tests.schemas.test_codec import MESSAGES
from tests.services.monitor.history.support.filling import STATEMENTS, fill
from tests.services.monitor.history.support.postgresql import PostgreSQL, running_postgresql
from tests.services.worldmodel.scene import Camera, Thing, watch

FOLDER: Final = Path(__file__).parent
ROWS: Final = 3
"""Of each table; of those of the users there is one."""

FROM_S, UNTIL_S = 1_764_000_000, 1_764_100_000
USER: Final = "ann"
PASSWORD: Final = "warehouse seven lights"  # noqa: S105 - of nobody


SITE: Final = "hall"
THINGS: Final = (Thing(4.0, 0.0), Thing(4.5, 1.5, (1.2, 0.8, 0.14), name="pallet"))


def world_state() -> bytes:
    """Return the state of a model that has seen some things."""
    model = SiteModel()
    watch(model, THINGS, [Camera(robot="r1"), Camera(0.5, 0.5, robot="r2")], 1.0, 8)
    return saved(SITE, "a1", 7, model)


async def make_history(url: str) -> None:
    """Make a database with something in every table that a monitor fills in time."""
    store = await Store.open(url)
    try:
        for table in STATEMENTS:
            await fill(store, table, ROWS, FROM_S, UNTIL_S)
        await store.write([], [], UNTIL_S * 10**9)
    finally:
        await store.close()
    user = User(USER, Role.OPERATOR, await Passwords().hash(PASSWORD), UNTIL_S * 10**9)
    await UserStore(users_url(url)).add(user)


def sqlite_text() -> str:
    """Return a history of SQLite as SQL."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "history.db"
        asyncio.run(make_history(f"sqlite:///{file}"))
        with closing(sqlite3.connect(file)) as database:
            return "\n".join(database.iterdump()) + "\n"


def postgresql_text() -> str:
    """Return a history of PostgreSQL as SQL, without what is different each time."""
    dump = ("pg_dump", "--format=plain", "--inserts", "--no-owner", "--no-privileges", "--no-comments")
    with running_postgresql() as server:
        url = server.create("history")
        asyncio.run(make_history(url))
        text = subprocess.run([*dump, url], check=True, capture_output=True, text=True).stdout
    lines = (line for line in text.splitlines() if line and not line.startswith(("--", "\\")))
    return "\n".join(lines) + "\n"


def make_wheel(folder: Path) -> None:
    """Make the package's wheel in a folder, without its weights: 12 MB that no other release's processes need."""
    with TemporaryDirectory() as made:
        build = (sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", made)
        subprocess.run(build, check=True, cwd=FOLDER.parents[1], capture_output=True)
        (whole,) = Path(made).glob("*.whl")
        with ZipFile(whole) as source, ZipFile(folder / whole.name, "w", ZIP_DEFLATED, compresslevel=9) as target:
            for each in source.infolist():
                if each.filename.endswith("/RECORD"):
                    lines = source.read(each).decode().splitlines(keepends=True)
                    target.writestr(each, "".join(line for line in lines if not _is_weights(line.partition(",")[0])))
                elif not _is_weights(each.filename):
                    target.writestr(each, source.read(each))


def _is_weights(name: str) -> bool:
    return name.startswith("services/detector/weights/") and name.endswith((".pt", ".onnx"))


def messages() -> list[dict[str, str]]:
    """Return messages of every type, encoded, with what says so on Zenoh."""
    return [
        {
            "schema": type(message).__name__,
            "encoding": codec.encoding(type(message)),
            "payload": base64.b64encode(codec.encode(message)).decode(),
        }
        for message in MESSAGES
    ]


def load_sqlite(text: str, file: Path) -> str:
    """Make a database of what `sqlite_text` returned, and return where it is."""
    with closing(sqlite3.connect(file)) as database:
        database.executescript(text)
    return f"sqlite:///{file}"


def load_postgresql(text: str, server: PostgreSQL, name: str) -> str:
    """Make a database of what `postgresql_text` returned, and return where it is."""
    url = server.create(name)
    psql = ("psql", "--quiet", "--no-psqlrc", "--set=ON_ERROR_STOP=1", "--output=/dev/null", url)
    subprocess.run(psql, input=text, text=True, check=True)
    return url


def plain(payload: bytes) -> Any:
    """Return what is in a message as a program without its schema has it, and as JSON has it."""
    return json.loads(msgspec.json.encode(msgspec.msgpack.decode(payload)))


def main() -> None:
    """Record it."""
    pyproject = tomllib.loads((FOLDER.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    folder = FOLDER / pyproject["project"]["version"]
    if folder.exists():
        sys.exit(
            f"{folder} is there: remove it if that version is not released yet, else set a new one in pyproject.toml"
        )
    made = folder.with_name(f".{folder.name}")
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir()
    (made / "messages.json").write_text(json.dumps(messages(), indent=1) + "\n", encoding="utf-8")
    (made / "messages.schema.json").write_text(json.dumps(json_schema(), sort_keys=True) + "\n", encoding="utf-8")
    (made / "history.sqlite.sql").write_text(sqlite_text(), encoding="utf-8")
    (made / "history.postgresql.sql").write_text(postgresql_text(), encoding="utf-8")
    (made / "world.state").write_bytes(world_state())
    make_wheel(made)
    made.rename(folder)


if __name__ == "__main__":
    main()
