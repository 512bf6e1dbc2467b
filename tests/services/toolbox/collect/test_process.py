"""The command beside a small fleet on a real bus."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from bus import Bus, QoS, Reply, Request
from schemas import codec, worker_keys
from schemas.detections import Box, ClassList, Detection, Detections, class_list
from schemas.keys import CameraKey, Stream
from schemas.models import SavedPicture
from schemas.worker_keys import WorkerAlive
from services.monitor.requests.picture_requests import SavePictureError, save_picture
from services.toolbox.collect.process import run
from services.toolbox.collect.settings import CollectSettings
from tests.fleetsight.stand_in import FOUND, FRONT, stand_in
from tests.schemas.frames import header
from tests.waiting import until


def settings(endpoint: str, folder: Path, **more: Any) -> CollectSettings:
    given = {"connect": [endpoint], "folder": folder, "rest_s": 0, "least_difference": 0, **more}
    return CollectSettings.model_validate(given)


def records(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "collected.jsonl").read_text().splitlines()]


async def test_a_picture_now_and_then_until_there_are_enough(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, most=3)) == 0
        await until(lambda: not fleet.wanted(Stream.COLOR))
    assert [each["why"] for each in records(tmp_path)] == ["every 0.1 s"] * 3
    assert len(list((tmp_path / "train/images").glob("*.jpg"))) == 3
    assert len(list((tmp_path / "train/labels").glob("*.txt"))) == 3
    assert capsys.readouterr().out == f"3 pictures saved in {tmp_path}\n"


async def test_a_class_that_is_unsure(tmp_path: Path) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, unsure="0.7..0.8", most=1, robots="r*", split="val")) == 0
    (record,) = records(tmp_path)
    assert (record["why"], record["file"].split("/")[0]) == ("unsure: box 0.75", "val")


async def test_none_is_saved_twice_and_that_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.05, seconds=3, least_difference=1)) == 0
    assert len(records(tmp_path)) == 1
    assert "1 picture saved" in (said := capsys.readouterr().out)
    assert "like others" in said


@pytest.mark.parametrize("more", [{}, {"blur": ["person"]}, {"drafts": False, "blur": ["person"]}])
async def test_what_no_worker_answers_for_is_not_saved(
    more: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("services.toolbox.collect.process.ANSWER_S", 0.5)
    async with stand_in(worker=False) as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, seconds=3, **more)) == 1
    assert not (tmp_path / "train").exists()
    assert "without an answer of a detector worker" in capsys.readouterr().out


async def test_without_drafts_nobody_is_asked(tmp_path: Path) -> None:
    async with stand_in(worker=False) as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, most=1, drafts=False)) == 0
    assert "drafts_by" not in records(tmp_path)[0]


async def test_models_that_disagree(tmp_path: Path) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        key, kind = FRONT.stream(Stream.OPINION), codec.encoding(ClassList)
        async with fleet.bus.publisher(key, QoS.RESULT, encoding=kind) as opinions:
            opinions.put(codec.encode(msgspec.structs.replace(class_list(FOUND), classes=[])))
            assert await run(settings(fleet.endpoint, tmp_path, disagree=True, most=1)) == 0
    assert records(tmp_path)[0]["why"] == "models disagree: box"


async def test_keys_that_nobody_should_use_end_nothing(tmp_path: Path) -> None:
    async with (
        stand_in() as fleet,
        asyncio.timeout(60),
        fleet.bus.announce("fleet/r 1/front/color/alive"),
        fleet.bus.publisher("fleet/r 1/front/classes", QoS.RESULT, encoding=codec.encoding(ClassList)) as odd,
    ):
        odd.put(codec.encode(class_list(FOUND)))
        assert await run(settings(fleet.endpoint, tmp_path, unsure="0.7..0.8", most=1)) == 0


async def test_what_is_to_be_blurred_is(tmp_path: Path) -> None:
    person = Detection(name="person", score=0.9, box=Box(0, 0, 6, 4))

    async def infer(_: Request) -> Reply:
        found = Detections(header=header(), height=4, width=6, objects=[person], model="m", worker="w2")
        return Reply(codec.encode(found), codec.encoding(Detections))

    async with (
        stand_in(worker=False) as fleet,
        fleet.bus.announce(str(WorkerAlive("detector", "w2"))),
        fleet.bus.serve(worker_keys.infer("w2"), infer),
        asyncio.timeout(60),
    ):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, most=1, blur=["person"])) == 0
    (record,) = records(tmp_path)
    assert record["blurred"] == ["person"]
    (labels,) = (tmp_path / "train/labels").glob("*.txt")
    assert not labels.stat().st_size


@contextlib.asynccontextmanager
async def collecting(given: CollectSettings) -> AsyncIterator[None]:
    """Run the command until the context ends."""
    running = asyncio.create_task(run(given))
    try:
        yield
    finally:
        running.cancel()
        await asyncio.wait([running])


async def saved_when_asked(bus: Bus, camera: CameraKey = FRONT) -> SavedPicture | str:
    """Ask as the monitor does, until somebody collects; return what was saved, or why nothing was."""
    while True:
        try:
            return await save_picture(bus, camera, "ann")
        except SavePictureError as error:
            if not any(each in str(error) for each in ("nobody collects", "not online")) or camera != FRONT:
                return str(error)


async def test_pictures_that_somebody_asks_for_are_saved_however_alike(tmp_path: Path) -> None:
    given = {"asked": True, "least_difference": 64}
    async with stand_in() as fleet, asyncio.timeout(60), collecting(settings(fleet.endpoint, tmp_path, **given)):
        found = [await saved_when_asked(fleet.bus) for _ in range(2)]
        await until(lambda: not fleet.wanted(Stream.COLOR))
    assert [each["why"] for each in records(tmp_path)] == ["asked for by ann"] * 2
    files = [each["file"] for each in records(tmp_path)]
    assert found == [SavedPicture(file=file, folder=str(tmp_path), objects=len(FOUND.objects)) for file in files]
    assert all((tmp_path / file).exists() for file in files)


async def test_who_asks_is_told_why_nothing_was_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.toolbox.collect.process.ANSWER_S", 0.5)
    async with stand_in(worker=False) as fleet, asyncio.timeout(60):
        with pytest.raises(SavePictureError, match="nobody collects pictures: run fleetsight collect FOLDER --asked"):
            await save_picture(fleet.bus, FRONT, "ann")
        async with collecting(settings(fleet.endpoint, tmp_path, asked=True)):
            assert "r1/front: not saved: " in str(await saved_when_asked(fleet.bus))
            unknown = await saved_when_asked(fleet.bus, CameraKey("r1", "rear"))
            assert "r1/rear is not online, or not among the cameras that are collected from" in str(unknown)
    assert not (tmp_path / "train").exists()


async def test_no_camera_no_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, seconds=1, cameras="rear")) == 1
    assert capsys.readouterr().out == f"0 pictures saved in {tmp_path}\n"


async def test_a_full_folder_takes_no_more(tmp_path: Path) -> None:
    async with stand_in() as fleet, asyncio.timeout(60):
        await run(settings(fleet.endpoint, tmp_path, every_s=0.1, most=2))
        assert await run(settings(fleet.endpoint, tmp_path, every_s=0.1, most=2)) == 1
    assert len(records(tmp_path)) == 2


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({}, "nothing says when to take a picture: give one of --every-s"),
        ({"unsure": "0.4"}, "write two scores from 0 to 1, such as 0.25..0.4"),
        ({"unsure": "0.4..0.3"}, "write two scores"),
        ({"unsure": "a..b"}, "write two scores"),
        ({"every_s": 1, "robots": "r/1"}, "no such name can be"),
        ({"every_s": 1, "split": "all"}, "pattern"),
    ],
)
def test_what_cannot_be_meant_is_refused(given: dict[str, object], why: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=why):
        CollectSettings.model_validate({"folder": tmp_path, **given})
    assert np.isinf(CollectSettings(folder=tmp_path, every_s=1).unsure_span).all()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="no folder"):
        CollectSettings(folder=tmp_path / "file", every_s=1)
