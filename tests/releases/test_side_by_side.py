"""Each recorded release's own code beside today's: messages, databases, and a fleet of processes of both.

The release's processes run with today's versions of other packages, Zenoh's too, and with today's weights.
"""

import asyncio
import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pytest

import fleetsight
from schemas import codec
from services.monitor.history.export import run
from services.monitor.history.settings import ExportSettings
from services.toolbox.demo.children import free_ports
from tests.releases.installed import TODAY, Installed, process
from tests.releases.record import make_history, plain
from tests.releases.test_upgrade import EXPORTED, RELEASES, lost
from tests.schemas.test_codec import MESSAGES
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.history.test_store import opened
from tests.waiting import PATIENCE_S, next_of, until

READ: Final = """
import base64, json, sys
from schemas import codec

schemas = {schema.__name__: schema for schema in codec.MAX_BYTES}
for line in sys.stdin:
    name, payload, encoding = json.loads(line)
    if name in schemas:
        message = codec.decode(schemas[name], base64.b64decode(payload), encoding)
        print(json.dumps([name, base64.b64encode(codec.encode(message)).decode()]))
"""
"""Reads messages by the release's own schemas, and prints what those understood of them."""


@pytest.fixture(scope="module", params=RELEASES, ids=lambda release: release.name)
def release(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


@pytest.fixture(scope="module")
def installed(release: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed.of(release, tmp_path_factory.mktemp("release") / "venv")


def test_what_runs_is_the_release_and_not_todays_code(installed: Installed, release: Path) -> None:
    assert installed.run("-m", "fleetsight", "--version") == f"fleetsight {release.name}\n"
    names = "bus.__file__, gateway.__file__, schemas.__file__, services.__file__"
    found = installed.run("-c", f"import bus, gateway, schemas, services; print({names})").split()
    assert all(Path(each).is_relative_to(Path(installed.python).parents[1]) for each in found)


def test_it_reads_todays_messages_with_all_that_it_knows_of_them(installed: Installed) -> None:
    sent = {type(message).__name__: codec.encode(message) for message in MESSAGES}
    encodings = {type(message).__name__: codec.encoding(type(message)) for message in MESSAGES}
    lines = (json.dumps([name, base64.b64encode(each).decode(), encodings[name]]) for name, each in sent.items())
    told = [json.loads(line) for line in installed.run("-c", READ, given="\n".join(lines)).splitlines()]
    assert len(told) > 10
    for name, payload in told:
        understood = plain(base64.b64decode(payload))
        assert lost(understood, plain(sent[name]), name) == [], f"fields of {name} that it makes up"
        assert set(understood) == set(plain(sent[name])) & set(understood)


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
async def test_going_back_it_exports_what_todays_monitor_kept(
    installed: Installed, kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    if kind == "postgresql":
        url = request.getfixturevalue("postgresql").create(f"back_{Path(installed.python).parents[2].name}")
    await make_history(url)
    for what in EXPORTED:
        today, before = tmp_path / f"{what}.csv", tmp_path / f"{what}-before.csv"
        await run(ExportSettings.model_validate({"task": "export", "history": url, "to": today, "what": what}))
        options = ("--history", url, "--to", str(before), "--what", what)
        installed.run("-m", "fleetsight", "history", "export", *options)
        assert today.read_text(encoding="utf-8").count("\n") > 1
        assert before.read_text(encoding="utf-8") == today.read_text(encoding="utf-8"), what


async def seen_by(endpoint: str) -> tuple[fleetsight.ClassList, fleetsight.Distances, int]:
    """Return a list and distances of the robot with something in view, and how many objects the world has."""
    async with fleetsight.connect(endpoint, within_s=PATIENCE_S) as fleet:
        lists, distances = fleet.class_lists("r1"), fleet.distances("r1")
        while not (seen := await next_of(aiter(lists))).classes:
            pass
        measured = await next_of(aiter(distances))
        async with asyncio.timeout(PATIENCE_S):
            while not (found := await fleet.world()).objects:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.2)
        return seen, measured, len(found.objects)


async def heartbeat_ns(history: str) -> int:
    """Return when a monitor last wrote."""
    async with opened(history) as store:
        return await store.heartbeat_ns() or 0


@pytest.mark.parametrize(("upgraded", "database"), [("centre", "sqlite"), ("robot", "postgresql")])
async def test_a_fleet_half_of_which_is_upgraded_works_and_its_history_goes_on(
    installed: Installed, upgraded: str, database: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Either half first; then the other, over the history that the first monitor left."""
    port = free_ports(2)
    master = port + 1
    endpoint, history = f"tcp/127.0.0.1:{port}", f"sqlite:///{tmp_path}/history.db"
    if database == "postgresql":
        server: PostgreSQL = request.getfixturevalue("postgresql")
        history = server.create(f"turns_{port}")
    before: Sequence[str] = installed.command
    centre, robot = (TODAY, before) if upgraded == "centre" else (before, TODAY)
    connect = ("--connect", endpoint)
    at = ("--ros-master", f"http://127.0.0.1:{master}", "--ros-host", "127.0.0.1")
    monitor = ("monitor", "--listen", endpoint, "--history", history, "--web-port", "0")
    async with process(TODAY, "simulate", "--robots", "1", "--master-port", str(master)):
        async with (
            process(centre, *monitor) as told,
            process(centre, "worldmodel", *connect),
            process(robot, "gateway", "--robot", "r1", *connect, *at),
            process(robot, "distance", *connect),
            process(centre, "detector", *connect),
        ):
            seen, measured, objects = await seen_by(endpoint)
            assert seen.header.robot == measured.header.robot == "r1"
            assert objects > 0
            await until(lambda: "r1/camera: online" in "".join(told))
        beats_ns = [await heartbeat_ns(history)]
        for other in (robot, centre):  # forth, and back again
            async with process(other, *monitor) as told, process(robot, "gateway", "--robot", "r1", *connect, *at):
                await until(lambda: "r1/camera: online" in "".join(told))
            beats_ns.append(await heartbeat_ns(history))
    assert sorted(set(beats_ns)) == beats_ns  # each wrote to it
    rows = tmp_path / "sightings.csv"
    await run(ExportSettings.model_validate({"task": "export", "history": history, "to": rows, "what": "sightings"}))
    assert "\nr1,camera," in rows.read_text(encoding="utf-8")
