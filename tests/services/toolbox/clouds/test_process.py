import asyncio
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from msgspec.structs import replace

from bus import Bus, Publisher, QoS
from bus.fake import FakeNetwork
from schemas import codec
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from services.toolbox.clouds import process
from services.toolbox.clouds.drawing import Drawing
from services.toolbox.clouds.process import save, view
from services.toolbox.clouds.settings import CloudsSettings
from services.toolbox.errors import ViewerError
from tests.schemas.results import cloud, clouds
from tests.services.toolbox.clouds.reading import read_pcd, read_ply

FRONT = CameraKey("r1", "front")
SEEN = clouds(cloud((0.5, 0.25, 2.0), rgb=bytes([1, 2, 3])), seq=4)


def asked(do: str, **changes: object) -> CloudsSettings:
    return CloudsSettings.model_validate({"do": do, "robot": "r1", "camera": "front", **changes})


@pytest.fixture
async def buses() -> AsyncIterator[tuple[Bus, Bus]]:
    network = FakeNetwork()
    async with network.open_bus() as theirs, network.open_bus() as ours:
        yield theirs, ours


async def publishing(bus: Bus, *messages: bytes, until: asyncio.Event | None = None) -> None:
    """Send messages once somebody wants them, as a worker does."""
    wanted = asyncio.Event()

    def on_demand(now: bool) -> None:  # noqa: FBT001 - the bus calls it so
        if now:
            wanted.set()

    encoding = codec.encoding(ObjectClouds)
    async with bus.publisher(FRONT.stream(Stream.OBJECTS), QoS.IMAGE, encoding=encoding, on_demand=on_demand) as sender:
        await wanted.wait()
        await sent(sender, messages)
        if until is not None:
            await until.wait()


async def sent(sender: Publisher, messages: Sequence[bytes]) -> None:
    for message in messages:
        sender.put(message)
        await asyncio.sleep(0.02)


async def test_save_writes_each_message_once_in_both_formats(
    buses: tuple[Bus, Bus], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs, ours = buses
    folder = tmp_path / "new" / "clouds"
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, b"garbage", codec.encode(SEEN)))
        assert await save(ours, asked("save", folder=folder)) == 0
    stem = f"r1_front_{SEEN.header.stamp_ns}_4"
    assert sorted(path.name for path in folder.iterdir()) == [f"{stem}.pcd", f"{stem}.ply"]
    assert read_ply((folder / f"{stem}.ply").read_bytes())[1] == [(0.5, 0.25, 2.0, 1, 2, 3, 1, 0)]
    assert len(read_pcd((folder / f"{stem}.pcd").read_bytes())[1]) == 1
    said, complained = capsys.readouterr()
    assert said == "".join(f"{folder / stem}.{kind}: 1 points\n" for kind in ("ply", "pcd"))
    damaged, unmeasured = complained.splitlines()
    assert damaged.startswith("fleetsight clouds: message skipped: ")
    assert unmeasured == "fleetsight clouds: 1 object has no points: no points within its mask"


def contents(folder: Path) -> list[bytes]:
    return [file.read_bytes() for file in folder.iterdir()]


async def test_files_are_written_whole_although_it_is_told_to_stop(
    buses: tuple[Bus, Bus], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs, ours = buses
    begun, may_end = threading.Event(), threading.Event()

    def slowly(_: ObjectClouds) -> bytes:
        begun.set()
        may_end.wait(60)
        return b"whole"

    monkeypatch.setitem(process.WRITERS, "ply", slowly)
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, codec.encode(SEEN)))
        saving = group.create_task(save(ours, asked("save", folder=tmp_path, formats=["ply"])))
        assert await asyncio.to_thread(begun.wait, 60)
        saving.cancel()
        ended, _ = await asyncio.wait([saving], timeout=0.05)
        may_end.set()
        await asyncio.wait([saving])
    assert not ended
    assert contents(tmp_path) == [b"whole"]


@pytest.mark.parametrize(
    ("cameras", "reason"),
    [
        (["r1/front"], "a cloud worker and a detector must be running"),
        (["r1/left", "r1/right", "r2/front"], "r1 has no camera front, but left, right"),
        (["r2/front"], "r1 has no camera online"),
    ],
)
async def test_nothing_to_save_is_one_line(
    cameras: list[str], reason: str, buses: tuple[Bus, Bus], capsys: pytest.CaptureFixture[str]
) -> None:
    theirs, ours = buses
    async with AsyncExitStack() as stack:
        for each in cameras:
            await stack.enter_async_context(theirs.announce(CameraKey(*each.split("/")).alive(Stream.COLOR)))
        assert await save(ours, asked("save", timeout_s=0.05)) == 1
    assert capsys.readouterr().err == f"fleetsight clouds: no clouds of r1/front in 0.05 s; {reason}\n"


@pytest.mark.parametrize(
    ("unmeasured", "reason"),
    [
        ({}, "no object of the detector's classes was in view"),
        (
            {0: "no points arrived", 1: "no mask", 2: "no points arrived"},
            "2 objects have no points: no points arrived, 1 object has no points: no mask",
        ),
    ],
)
async def test_of_messages_without_points_it_is_said_why_and_none_is_saved(
    unmeasured: dict[int, str],
    reason: str,
    buses: tuple[Bus, Bus],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    theirs, ours = buses
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, codec.encode(replace(clouds(), unmeasured=unmeasured))))
        assert await save(ours, asked("save", folder=tmp_path / "new", timeout_s=1)) == 1
    assert capsys.readouterr() == ("", f"fleetsight clouds: no clouds of r1/front in 1 s; {reason}\n")
    assert not (tmp_path / "new").exists()


async def test_what_was_in_view_before_points_came_is_waited_past(
    buses: tuple[Bus, Bus], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs, ours = buses
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, codec.encode(clouds()), codec.encode(SEEN)))
        assert await save(ours, asked("save", folder=tmp_path, formats=["ply"])) == 0
    assert capsys.readouterr().out == f"{tmp_path}/r1_front_{SEEN.header.stamp_ns}_4.ply: 1 points\n"


async def test_a_folder_that_cannot_be_written_is_one_line(buses: tuple[Bus, Bus], tmp_path: Path) -> None:
    theirs, ours = buses
    (tmp_path / "file").write_text("")
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, codec.encode(SEEN)))
        with pytest.raises(ViewerError, match=r"--folder .*file/more: Not a directory"):
            await save(ours, asked("save", folder=tmp_path / "file" / "more"))


class FakeWindow:
    """Is closed by its user once it has shown so many clouds."""

    def __init__(self, closed_after: int) -> None:
        self.shown: list[Drawing] = []
        self._closed_after = closed_after

    def show(self, drawing: Drawing) -> None:
        self.shown.append(drawing)

    def turn(self) -> bool:
        return len(self.shown) < self._closed_after


async def test_view_shows_clouds_until_the_window_is_closed(buses: tuple[Bus, Bus]) -> None:
    theirs, ours = buses
    window, done = FakeWindow(2), asyncio.Event()
    async with asyncio.TaskGroup() as group:
        group.create_task(publishing(theirs, codec.encode(SEEN), codec.encode(clouds()), until=done))
        await view(ours, asked("view"), window)
        done.set()
    assert [drawing.xyz.tolist() for drawing in window.shown] == [[[0.5, 0.25, 2.0]], []]


WITHOUT_OPEN3D = """
import sys
sys.modules["open3d"] = None
from services.toolbox.command_line import main
raise SystemExit(main(["clouds", "view", "r1", "front"]))
"""


def test_without_open3d_there_is_one_clear_line() -> None:
    ended = subprocess.run([sys.executable, "-c", WITHOUT_OPEN3D], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (
        2,
        "fleetsight clouds: open3d is not installed; it comes with pip install -c constraints.txt '.[viewer]'\n",
    )
