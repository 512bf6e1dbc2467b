"""The command against workers with models of the test's own, on the real bus."""

import asyncio
import json
import os
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import simplejpeg

from bus import MAX_REQUEST_BYTES, BusSettings, RefusedError, Reply, open_bus
from fleetsight import asking
from schemas import worker_keys
from schemas.detections import Box, Detection, Detections, Mask
from schemas.worker_keys import WorkerAlive
from services.detector.model import DetectedObjects, Failed, Outcome, Request
from services.detector.requests import answering
from services.toolbox.demo.children import free_ports
from services.toolbox.detect import process
from services.toolbox.detect.process import run, table
from services.toolbox.detect.settings import DetectSettings
from tests.schemas.frames import header
from tests.services.detector.support.fakes import FakeModel
from tests.waiting import PATIENCE_S


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    assert cv2.imwrite(str(path), np.full((40, 60, 3), 99, np.uint8))
    return path


@asynccontextmanager
async def workers(models: Sequence[FakeModel]) -> AsyncIterator[str]:
    """Run workers without cameras; give the endpoint they are found at."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus, AsyncExitStack() as stack:
        for number, model in enumerate(models):
            await stack.enter_async_context(answering(bus, model, f"w{number}"))
            await stack.enter_async_context(bus.announce(str(WorkerAlive("detector", f"w{number}"))))
        yield endpoint


def settings(image: Path, endpoint: str, **fields: object) -> DetectSettings:
    return DetectSettings.model_validate({"image": image, "connect": [endpoint], "timeout_s": 5, **fields})


async def test_it_prints_what_a_worker_sees_and_draws_it(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async with workers([FakeModel()]) as endpoint:
        assert await run(settings(image, endpoint)) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].split() == ["object", "score", "left", "top", "right", "bottom"]
    assert printed[1].split() == ["box", "0.75", "0", "0", "60", "40"]
    assert printed[2:] == ["1 objects by fake of w0", f"drawn in {image.with_name('photo.detected.jpg')}"]
    drawn = cv2.imread(str(image.with_name("photo.detected.jpg")))
    assert drawn is not None
    assert drawn.shape == (40, 60, 3)


class DamagingModel(FakeModel):
    """Answers with masks that are none."""

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        found = await super().infer(batch)
        return [
            DetectedObjects([msgspec.structs.replace(box, mask=Mask((40, 60), "1")) for box in _objects(each)])
            for each in found
        ]


def _objects(outcome: Outcome) -> Sequence[Detection]:
    assert isinstance(outcome, DetectedObjects)
    return outcome.objects


async def test_a_damaged_mask_is_not_drawn_and_that_is_one_line(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with workers([DamagingModel()]) as endpoint:
        assert await run(settings(image, endpoint)) == 1
    said = capsys.readouterr()
    assert said.err.startswith(f"fleetsight detect: {image.with_name('photo.detected.jpg')}: nothing is drawn: ")
    assert (said.err.count("\n"), said.out.count("box")) == (1, 1)


async def test_what_was_found_is_printed_also_where_nothing_can_be_drawn(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with workers([FakeModel()]) as endpoint:
        known = settings(image, endpoint, json=True, output="/dev/full")
        assert await run(known) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["objects"][0]["name"] == "box"
    assert said.err == f"fleetsight detect: {known.output}: nothing is drawn: No space left on device\n"


async def test_a_picture_that_is_begun_becomes_whole(image: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawing, may_end = threading.Event(), threading.Event()

    def draw(_found: Detections, _image: bytes, output: Path) -> None:
        drawing.set()
        may_end.wait()
        output.write_bytes(b"whole")

    monkeypatch.setattr(process, "_draw", draw)
    async with workers([FakeModel()]) as endpoint:
        known = settings(image, endpoint)
        running = asyncio.create_task(run(known))
        assert await asyncio.to_thread(drawing.wait, PATIENCE_S)
        running.cancel()
        done, _ = await asyncio.wait([running], timeout=0.1)
        assert not done
        may_end.set()
        await asyncio.wait([running])
    assert running.cancelled()
    assert known.drawing.read_bytes() == b"whole"


async def test_the_largest_photographs_are_drawn_too(tmp_path: Path) -> None:
    photograph = tmp_path / "photo.png"
    assert cv2.imwrite(str(photograph), np.zeros((8_000, 8_000, 3), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    async with workers([FakeModel()]) as endpoint:
        assert await run(settings(photograph, endpoint, timeout_s=60)) == 0
    height, width, *_ = simplejpeg.decode_jpeg_header((tmp_path / "photo.detected.jpg").read_bytes())
    assert (height, width) == (8_000, 8_000)


def test_a_models_names_write_nothing_but_themselves() -> None:
    found = Detections(
        header=header(),
        height=2,
        width=2,
        objects=[Detection(name="\x1b[2J", score=0.5, box=Box(0, 0, 2, 2))],
        model="a\nb.pt",
        worker="w\r1",
    )
    assert table(found).splitlines() == [
        "object   score  left  top  right  bottom",
        r"\x1b[2J   0.50     0    0      2       2",
        r"1 objects by a\nb.pt of w\r1",
    ]


async def test_json_and_a_file_of_ones_own(image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async with workers([FakeModel()]) as endpoint:
        assert await run(settings(image, endpoint, json=True, output=tmp_path / "drawn.jpg")) == 0
    assert json.loads(capsys.readouterr().out)["objects"][0]["name"] == "box"
    assert (tmp_path / "drawn.jpg").is_file()


async def test_several_workers_share_the_work(image: Path) -> None:
    models = [FakeModel() for _ in range(2)]
    async with workers(models) as endpoint:
        for _ in range(20):
            await run(settings(image, endpoint))
            if all(model.seen for model in models):
                break
    assert all(model.seen for model in models)


async def test_why_there_is_no_answer(image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text.jpg").write_text("no image")
    async with workers([FakeModel()]) as endpoint:
        assert await run(settings(tmp_path / "text.jpg", endpoint)) == 1
    async with workers([]) as endpoint:
        assert await run(settings(image, endpoint, timeout_s=0.3)) == 1
    refused, nobody = capsys.readouterr().err.splitlines()
    assert refused.startswith(f"fleetsight detect: {tmp_path}/text.jpg: worker w0: not an image")
    assert "no detector worker was seen within 0.3 s" in nobody


class BusyModel(FakeModel):
    """Has something else to do at first, as its worker says; and counts how often it was asked."""

    def __init__(self, refusals: int) -> None:
        super().__init__()
        self.refusals = refusals
        self.asked = 0

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        self.asked += 1
        if self.asked <= self.refusals:
            return [Failed("busy", RuntimeError("3 requests are under way already"))]
        return await super().infer(batch)


async def test_workers_that_are_busy_are_asked_again_until_the_time_is_up(
    image: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "BUSY_RETRY_S", (0.01, 0.02))
    model = BusyModel(3)
    async with workers([model]) as endpoint:
        assert await run(settings(image, endpoint)) == 0
    assert model.asked == 4
    never = BusyModel(1_000_000)
    async with workers([never]) as endpoint:
        assert await run(settings(image, endpoint, timeout_s=1)) == 1
    assert never.asked > 1
    (why,) = capsys.readouterr().err.splitlines()
    assert "worker w0: " in why


async def test_a_worker_that_was_busy_is_no_slow_one_for_the_little_time_that_was_left(
    image: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "BUSY_RETRY_S", (0.01, 0.02))
    model = BusyModel(1)
    model.may_answer.clear()
    async with workers([model]) as endpoint:
        assert await run(settings(image, endpoint, timeout_s=1)) == 1
        model.may_answer.set()
    assert model.asked == 2
    said = f"fleetsight detect: {image}: worker w0: busy: 3 requests are under way already\n"
    assert capsys.readouterr().err == said


async def test_a_worker_that_is_seen_when_the_time_is_up_was_seen(
    image: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "GATHER_S", 60)
    async with workers([FakeModel()]) as endpoint:
        assert await run(settings(image, endpoint, timeout_s=1)) == 1
    said = "fleetsight detect: a detector worker was seen, but none answered within 1 s\n"
    assert capsys.readouterr().err == said


async def test_why_a_worker_ends_is_said_when_there_is_no_other(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint, asked = f"tcp/127.0.0.1:{free_ports(1)}", asyncio.Event()

    async def refuse(_: object) -> Reply:
        asked.set()
        raise RefusedError("busy: this worker ends: no memory")

    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as bus,
        bus.announce(str(WorkerAlive("detector", "w0"))),
        asyncio.TaskGroup() as group,
    ):
        async with bus.serve(worker_keys.infer("w0"), refuse):
            running = group.create_task(run(settings(image, endpoint)))
            await asked.wait()
        assert await running == 1
    said = f"fleetsight detect: {image}: worker w0: busy: this worker ends: no memory\n"
    assert capsys.readouterr().err == said


async def test_a_file_that_is_no_image_is_named_before_a_model_is_loaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "load_all", None)
    file = tmp_path / "text.jpg"
    file.write_text("no image")
    assert await run(DetectSettings.model_validate({"image": file, "local": True})) == 1
    assert capsys.readouterr().err.startswith(f"fleetsight detect: {file}: not an image")


async def test_a_model_that_works_no_longer_is_a_failure_and_no_wrong_setting(
    image: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "load_all", lambda *_: FakeModel(broken=True))
    assert await run(settings(image, "tcp/127.0.0.1:1", local=True)) == 1
    assert capsys.readouterr().err == f"fleetsight detect: {image}: no memory\n"


async def test_an_image_that_is_too_large_to_be_sent_is_one_line(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with image.open("ab") as file:
        file.truncate(MAX_REQUEST_BYTES + 1)
    assert await run(settings(image, "tcp/127.0.0.1:1")) == 1
    said = f"{image}: a file of 16777217 bytes, at most 16777216 are sent to a worker; --local looks at it here"
    assert capsys.readouterr().err == f"fleetsight detect: {said}\n"


async def test_what_is_no_worker_is_not_asked(image: Path) -> None:
    async with (
        workers([FakeModel()]) as endpoint,
        open_bus(BusSettings(connect=[endpoint])) as bus,
        bus.announce("workers/detector/_/1/-/alive"),
        bus.announce("workers/detector/w9/heavy/-/alive"),
    ):
        assert await run(settings(image, endpoint)) == 0


async def test_an_image_that_cannot_be_read_is_one_line(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = settings(image, "tcp/127.0.0.1:1", local=True)
    await asyncio.to_thread(image.unlink)
    assert await run(known) == 1
    assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"image": "absent.jpg"}, "--image absent.jpg: no such file"),
        ({"image": "."}, "--image .: not a file"),
        ({"image": "x" * 300}, "x: File name too long"),
        ({"model": "x.pt"}, "--local"),
        ({"model": "x.pt", "local": True}, "--model x.pt: no such file"),
        ({"model": "fleet", "local": True}, "--model fleet: only --model of `fleetsight detector` follows the fleet's"),
        ({"model": ".", "local": True}, "--model .: a folder"),
        ({"image": os.fsdecode(b"\xff.jpg")}, r"--image \\udcff.jpg: no such file"),
        ({"model": os.fsdecode(b"\xff.pt"), "local": True}, r"--model \\udcff.pt: no such file"),
        ({"output": "absent/x.jpg"}, "--output absent/x.jpg: absent is no folder"),
        ({"output": "drawn.png"}, "--output drawn.png: what is written is JPEG: .jpg"),
    ],
)
def test_what_cannot_be_is_named(image: Path, fields: dict[str, object], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        DetectSettings.model_validate({"image": image, **fields})


def test_the_image_is_not_drawn_over(image: Path) -> None:
    symbolic, hard, folder = (image.with_name(name) for name in ("symbolic.png", "hard.png", "folder"))
    symbolic.symlink_to(image)
    hard.hardlink_to(image)
    folder.mkdir()
    for output in (image, symbolic, hard, folder / ".." / image.name):
        with pytest.raises(ValueError, match="that is the image, which would be lost"):
            DetectSettings.model_validate({"image": image, "output": output})
    with pytest.raises(ValueError, match=f"--output {folder}: a folder"):
        DetectSettings.model_validate({"image": image, "output": folder})
