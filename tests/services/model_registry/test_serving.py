"""The registry on the real bus: published, listed, fetched and used by others; late subscribers know its state."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest

from bus import LATEST, Bus, NotServedError, RefusedError, Reply, Request, RequestError
from schemas import codec
from schemas.models import PIECE_BYTES, ModelPiece, ModelRegistry, ModelUse
from schemas.worker_keys import ModelKey
from services.detector.fetching import fetch_rest
from services.model_registry import client
from services.model_registry.client import ask_registry, publish_model, use_model
from services.model_registry.registry import digest_of
from services.model_registry.serving import serving_models
from tests.services.model_registry.buses import two_buses
from tests.services.model_registry.publishing import LONG, model_of, publish_file
from tests.waiting import PATIENCE_S, receive


@pytest.fixture
async def other(tmp_path: Path) -> AsyncIterator[Bus]:
    async with two_buses() as (monitor, bus), serving_models(monitor, tmp_path / "registry"):
        yield bus


async def test_a_file_goes_there_and_back(other: Bus, tmp_path: Path) -> None:
    content = LONG * 5
    sent: list[int] = []
    file, model = tmp_path / "sent", model_of(content, "site")
    file.write_bytes(content)
    await publish_model(other, model, file, sent.append)
    assert sent[-1] == len(content)
    assert len(sent) == -(-len(content) // PIECE_BYTES)
    (known,) = (await ask_registry(other, PATIENCE_S)).models
    assert msgspec.structs.replace(known, published_ns=0) == model
    got: list[int] = []
    await fetch_rest(other, known, tmp_path / "got", got.append)
    assert got[-1] == len(content)
    assert digest_of(tmp_path / "got") == model.digest


async def test_who_comes_late_hears_the_state_and_every_change(other: Bus, tmp_path: Path) -> None:
    one = await publish_file(other, tmp_path, b"one", "one")
    async with other.subscribe(ModelKey.REGISTRY, LATEST) as states:
        assert [each.digest for each in (await receive(states, ModelRegistry)).models] == [one]
        answer = await use_model(other, ModelUse(digest=one), PATIENCE_S)
        assert answer.in_force == one
        async with asyncio.timeout(PATIENCE_S):
            while await receive(states, ModelRegistry) != answer:
                pass


async def test_what_is_refused_says_why(other: Bus, tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="no published model has the digest"):
        await use_model(other, ModelUse(digest="0" * 64), PATIENCE_S)
    with pytest.raises(RefusedError, match="no published model has the digest"):
        await fetch_rest(other, model_of(b"unknown", "x"), tmp_path / "x", lambda _: None)
    for key in ModelKey.PIECE, ModelKey.PUBLISH, ModelKey.USE:
        with pytest.raises(RefusedError, match="encoded as"):
            await other.request(key, b"\x80", timeout_s=PATIENCE_S)
    (tmp_path / "cut").write_bytes(b"cut")
    with pytest.raises(RefusedError, match="a piece 0 of 3 bytes does not belong to long"):
        await publish_model(other, model_of(LONG, "long"), tmp_path / "cut", lambda _: None)


async def test_a_monitor_that_starts_again_meanwhile_gets_all_pieces_again(tmp_path: Path) -> None:
    file, model = tmp_path / "site", model_of(LONG * 2, "site")
    file.write_bytes(LONG * 2)
    async with two_buses() as (monitor, other):
        async with serving_models(monitor, tmp_path / "registry"):
            begun = asyncio.Event()

            def at_first(_: int) -> None:
                begun.set()
                raise RequestError("given up")

            with pytest.raises(RequestError, match="given up"):
                await publish_model(other, model, file, at_first)
        assert begun.is_set()
        async with serving_models(monitor, tmp_path / "registry"):
            await publish_model(other, model, file, lambda _: None)
            assert (await ask_registry(other, PATIENCE_S)).find(model.digest) is not None
        with pytest.raises(NotServedError):
            await ask_registry(other, PATIENCE_S)


async def test_a_piece_of_another_size_is_not_taken(tmp_path: Path) -> None:
    model = model_of(LONG, "site")
    async with two_buses() as (monitor, other):

        async def lie(_: Request) -> Reply:
            piece = ModelPiece(digest=model.digest, index=0, data=memoryview(b"short"))
            return Reply(codec.encode(piece), codec.encoding(ModelPiece))

        async with monitor.serve(ModelKey.PIECE, lie):
            with pytest.raises(RequestError, match="with 5 bytes"):
                await fetch_rest(other, model, tmp_path / "got", lambda _: None)


async def test_who_is_not_answered_asks_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "AGAIN_S", (0, 0.01))
    model = model_of(b"one", "one")
    (tmp_path / "one").write_bytes(b"one")
    errors = [RefusedError("busy: 2 requests are under way already"), RefusedError("the disk is gone")]
    async with two_buses() as (monitor, other):

        async def refuse(_: Request) -> Reply:
            raise errors.pop(0)

        async with monitor.serve(ModelKey.PUBLISH, refuse):
            with pytest.raises(RefusedError, match="the disk is gone"):
                await publish_model(other, model, tmp_path / "one", lambda _: None)
        with pytest.raises(NotServedError):
            await publish_model(other, model, tmp_path / "one", lambda _: None)
    assert errors == []
