"""Several monitors with --models, and files that are damaged: one serves, the others say so and take over."""

import asyncio
from contextlib import AsyncExitStack, suppress
from pathlib import Path

import msgspec
import pytest

from bus import QUEUE, Bus, NotServedError, QoS, RequestError
from schemas import codec
from schemas.models import ModelRegistry, ModelUse
from schemas.worker_keys import ModelKey
from services.model_registry import serving, uploads
from services.model_registry.client import ask_registry, publish_model, use_model
from services.model_registry.folder import UPLOADS, RegistryError
from services.model_registry.serving import ModelService, serving_models
from tests.services.model_registry.buses import two_buses
from tests.services.model_registry.publishing import LONG, model_of, publish_file
from tests.waiting import PATIENCE_S, receive, until


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "AGAIN_S", 0.1)
    monkeypatch.setattr(serving, "GONE_S", 2.0)


def errors(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [each.getMessage() for each in caplog.records if each.levelname == "ERROR"]


async def test_the_second_stands_by_says_so_and_takes_over_when_the_first_is_gone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with two_buses() as (one, other), AsyncExitStack() as first:
        await first.enter_async_context(serving_models(one, tmp_path / "one"))
        digest = await publish_file(one, tmp_path, b"one", "model")
        told = (await ask_registry(other, PATIENCE_S)).registry
        async with serving_models(other, tmp_path / "other") as second:
            assert second.state is None
            (problem,) = second.problems()
            assert problem.startswith(f"--models {tmp_path}/other is not served: {told} serves models already")
            async with other.subscribe(ModelKey.REGISTRY, QUEUE(100)) as states:
                assert {(await receive(states, ModelRegistry)).registry for _ in range(5)} == {told}
            assert second.state is None
            assert (await ask_registry(other, PATIENCE_S)).find(digest) is not None
            assert errors(caplog) == [problem]
            await first.aclose()
            await until(lambda: second.state is not None)
            assert (await ask_registry(one, PATIENCE_S)).models == []
            assert second.problems() == []


async def test_one_that_hears_an_earlier_one_only_later_ends(tmp_path: Path) -> None:
    async with two_buses() as (monitor, other), serving_models(monitor, tmp_path / "own") as service:
        digest = await publish_file(other, tmp_path, b"one", "one")
        own = await ask_registry(other, PATIENCE_S)
        later = msgspec.structs.replace(own, registry="later", since_ns=own.since_ns + 1)
        await tell(other, later)
        await until(lambda: service.problems() == ["later serves models too: give one monitor --models"])
        assert service.state is not None
        await tell(other, msgspec.structs.replace(own, registry="earlier\x1b", since_ns=own.since_ns - 1))
        await until(lambda: service.state is None)
        assert "is not served: earlier\\x1b serves models already" in service.problems()[0]
        await until_unanswered(other)
        await until(lambda: service.state is not None)
        again = await ask_registry(other, PATIENCE_S)
        assert again.find(digest) is not None
        assert again.since_ns > own.since_ns
        await until(lambda: service.problems() == [])


async def until_unanswered(bus: Bus) -> None:
    async with asyncio.timeout(PATIENCE_S):
        with suppress(NotServedError):
            while True:
                await ask_registry(bus, PATIENCE_S)


async def tell(bus: Bus, state: ModelRegistry) -> None:
    encoding = codec.encoding(ModelRegistry)
    async with bus.publisher(ModelKey.REGISTRY, QoS.STATUS, encoding=encoding) as publisher:
        publisher.put(codec.encode(state))


async def test_of_two_on_one_folder_that_do_not_hear_each_other_one_waits(tmp_path: Path) -> None:
    async with two_buses() as (one, _), two_buses() as (other, _), AsyncExitStack() as first:
        await first.enter_async_context(serving_models(one, tmp_path))
        async with serving_models(other, tmp_path) as second:
            assert second.state is None
            assert second.problems() == [
                f"--models {tmp_path}: another process serves this folder: give one monitor --models"
            ]
            await first.aclose()
            await until(lambda: second.state is not None)
            assert second.problems() == []


async def test_what_fails_later_is_a_problem_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    failing = RuntimeError("no such thing")
    async with two_buses() as (monitor, _), serving_models(monitor, tmp_path) as service:
        with monkeypatch.context() as broken:

            def fail(_: ModelService) -> None:
                raise failing

            broken.setattr(ModelService, "_keep_on", fail)
            await until(service.problems)
            assert service.problems() == [
                "the model registry failed, and is tried again: RuntimeError('no such thing')"
            ]
        await until(lambda: service.problems() == [])
    assert "the model registry failed" in caplog.text


async def test_a_folder_that_cannot_be_used_is_an_error_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    async with two_buses() as (monitor, _):
        with pytest.raises(RegistryError, match="file: File exists"):
            async with serving_models(monitor, tmp_path / "file"):
                pass


async def test_an_error_of_the_monitor_arrives_as_it_is(tmp_path: Path) -> None:
    async with two_buses() as (monitor, other):
        with pytest.raises(ValueError, match="a bad rule"):
            async with serving_models(monitor, tmp_path):
                raise ValueError("a bad rule")
        with pytest.raises(NotServedError):
            await ask_registry(other, PATIENCE_S)


async def test_a_damaged_file_is_withdrawn_while_others_are_served(tmp_path: Path) -> None:
    folder = tmp_path / "registry"
    async with two_buses() as (monitor, other):
        async with serving_models(monitor, folder):
            one, two = [await publish_file(other, tmp_path, each, each.decode()) for each in (b"one", b"two")]
            await use_model(other, ModelUse(digest=one), PATIENCE_S)
        (folder / f"{one}.pt").write_bytes(b"off")
        async with serving_models(monitor, folder) as service:
            await until(service.problems)
            state = await ask_registry(other, PATIENCE_S)
            assert ([each.digest for each in state.models], state.in_force) == ([two], "")
            assert "which was in force, is withdrawn" in service.problems()[0]


async def test_half_a_file_ends_without_another_upload(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "half"
    file.write_bytes(LONG * 5)

    def give_up(_: int) -> None:
        raise RequestError("given up")

    async with two_buses() as (monitor, other), serving_models(monitor, tmp_path / "registry"):
        with pytest.raises(RequestError, match="given up"):
            await publish_model(other, model_of(LONG * 5, "half"), file, give_up)
        assert list((tmp_path / "registry" / UPLOADS).iterdir())
        monkeypatch.setattr(uploads, "UPLOAD_IDLE_S", 0.0)
        await until(lambda: not list((tmp_path / "registry" / UPLOADS).iterdir()))
