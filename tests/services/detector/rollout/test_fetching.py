"""A model fetched piece by piece, where the link is cut meanwhile."""

import asyncio
from pathlib import Path

import pytest

from bus import RefusedError, Reply, Request, RequestError
from bus.fake import FakeNetwork
from schemas import codec
from schemas.models import PIECE_BYTES, ModelPiece, ModelPieceRequest
from schemas.worker_keys import ModelKey
from services.detector.fetching import fetch_rest
from tests.services.model_registry.publishing import LONG, model_of

CONTENT = LONG + LONG
MODEL = model_of(CONTENT, "site")


async def test_pieces_come_one_at_a_time_and_go_on_where_they_stopped(tmp_path: Path) -> None:
    asked: list[int] = []
    at_once: list[int] = []
    cut = {1}

    async def piece(request: Request) -> Reply:
        index = codec.decode(ModelPieceRequest, request.payload, request.encoding).index
        asked.append(index)
        at_once.append(index)
        assert len(at_once) == 1
        await asyncio.sleep(0)
        at_once.remove(index)
        if index in cut:
            cut.remove(index)
            raise RefusedError("busy")
        data = memoryview(CONTENT[index * PIECE_BYTES : (index + 1) * PIECE_BYTES])
        found = ModelPiece(digest=MODEL.digest, index=index, data=data)
        return Reply(codec.encode(found), codec.encoding(ModelPiece))

    file, there = tmp_path / "part", list[int]()
    async with FakeNetwork().open_bus() as bus, bus.serve(ModelKey.PIECE, piece):
        with pytest.raises(RequestError, match="busy"):
            await fetch_rest(bus, MODEL, file, there.append)
        assert await asyncio.to_thread(file.read_bytes) == CONTENT[:PIECE_BYTES]
        with await asyncio.to_thread(file.open, "ab") as half:
            half.write(b"half a piece")
        await fetch_rest(bus, MODEL, file, there.append)
    assert await asyncio.to_thread(file.read_bytes) == CONTENT
    assert asked == [0, 1, 1, 2]
    assert there == [PIECE_BYTES, 2 * PIECE_BYTES, len(CONTENT)]


async def test_a_piece_of_another_size_is_an_error(tmp_path: Path) -> None:
    async def piece(_: Request) -> Reply:
        found = ModelPiece(digest=MODEL.digest, index=0, data=memoryview(b"short"))
        return Reply(codec.encode(found), codec.encoding(ModelPiece))

    async with FakeNetwork().open_bus() as bus, bus.serve(ModelKey.PIECE, piece):
        with pytest.raises(RequestError, match=r"piece 0 of site@\w+ came as another one, or with 5 bytes"):
            await fetch_rest(bus, MODEL, tmp_path / "part", lambda _: None)
