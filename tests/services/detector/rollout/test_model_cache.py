"""Published models on a worker's machine: only whole files with the right digest are used."""

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest

from schemas.models import ModelRegistry
from services.detector.model_cache import DamagedModelError, ModelCache, usable_cache
from tests.services.model_registry.publishing import model_of

SITE = model_of(b"weights", "site")


async def fill(cache: ModelCache, content: bytes = b"weights") -> None:
    async def fetch(file: Path) -> None:
        await asyncio.to_thread(file.write_bytes, content)

    await cache.fill(SITE, fetch)


async def test_a_model_is_there_once_it_is_whole(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)
    assert not cache.holds(SITE)
    await fill(cache)
    assert cache.holds(SITE)
    assert cache.path(SITE).name == f"site@{SITE.digest[:12]}.pt"


async def test_another_file_is_not_kept(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)
    with pytest.raises(DamagedModelError, match="has another digest than what was published"):
        await fill(cache, b"WEIGHTS")
    assert list(cache.folder.iterdir()) == []


async def test_half_a_file_is_no_model_and_goes_on_until_the_process_ends(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)

    async def fetch_half(file: Path) -> None:
        await asyncio.to_thread(file.write_bytes, b"wei")
        raise TimeoutError

    with pytest.raises(TimeoutError):
        await cache.fill(SITE, fetch_half)
    assert not cache.holds(SITE)

    async def fetch_rest(file: Path) -> None:
        with await asyncio.to_thread(file.open, "ab") as part:
            part.write(b"ghts")

    await cache.fill(SITE, fetch_rest)
    assert cache.holds(SITE)
    cache.path(SITE).unlink()
    with pytest.raises(TimeoutError):
        await cache.fill(SITE, fetch_half)
    cache.close()
    assert list(cache.folder.iterdir()) == []


async def test_parts_of_another_model_and_of_killed_workers_go(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)
    cache.folder.mkdir()
    killed, neighbour = cache.folder / "a@1.pt.0.part", cache.folder / "b@1.pt.0.part"
    for each in (killed, neighbour):
        each.touch()
    os.utime(killed, (1, 1))

    async def fetch_nothing(file: Path) -> None:
        await asyncio.to_thread(file.touch)
        raise TimeoutError

    with pytest.raises(TimeoutError):
        await cache.fill(model_of(b"other", "other"), fetch_nothing)
    await fill(cache)
    assert set(cache.folder.iterdir()) == {neighbour, cache.path(SITE)}


@pytest.mark.parametrize("content", [b"WEIGHTS", b"wei"])
async def test_a_file_that_was_damaged_is_fetched_again(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    cache = ModelCache(tmp_path)
    await fill(cache)
    cache.path(SITE).write_bytes(content)
    assert not cache.holds(SITE)
    assert "is damaged, and fetched again" in caplog.text
    assert not cache.path(SITE).exists()


async def test_it_remembers_what_was_run_and_drops_what_the_registry_no_longer_has(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)
    assert cache.recall() is None
    await fill(cache)
    state = ModelRegistry(models=[SITE], in_force=SITE.digest)
    cache.remember(state)
    assert ModelCache(tmp_path).recall() == state
    cache.remember(ModelRegistry(models=[]))
    assert cache.path(SITE).exists()  # another worker of the machine may be about to load it
    os.utime(cache.path(SITE), (1, 1))
    assert cache.holds(SITE)
    cache.remember(ModelRegistry(models=[]))
    assert cache.path(SITE).exists()
    os.utime(cache.path(SITE), (1, 1))
    cache.remember(ModelRegistry(models=[]))
    assert not cache.path(SITE).exists()


def test_workers_of_one_machine_remember_at_the_same_time(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def remember(_: int) -> None:
        cache = ModelCache(tmp_path)
        for _ in range(100):
            cache.remember(ModelRegistry(models=[SITE], in_force=SITE.digest))

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(remember, range(4)))
    assert not caplog.records
    assert ModelCache(tmp_path).recall() is not None


def test_a_cache_that_cannot_be_written_is_replaced(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    assert usable_cache(tmp_path / "cache", tmp_path / "spare") == tmp_path / "cache"
    assert usable_cache(tmp_path / "file", tmp_path / "spare") == tmp_path / "spare"
    assert f"until this worker ends only: --cache {tmp_path / 'file'}: " in caplog.text


def test_what_cannot_be_read_or_written_stops_nobody(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    cache = ModelCache(tmp_path / "file")
    cache.remember(ModelRegistry(models=[SITE]))
    assert "a start without a monitor will not know this model" in caplog.text
    assert cache.recall() is None
    assert not cache.holds(SITE)
    damaged = ModelCache(tmp_path)
    damaged.folder.mkdir()
    (damaged.folder / "last.json").write_bytes(b'{"models": 1}')
    assert damaged.recall() is None


async def test_an_exported_model_keeps_the_name_of_its_form(tmp_path: Path) -> None:
    exported = msgspec.structs.replace(SITE, form="onnx")
    cache = ModelCache(tmp_path)
    cache.folder.mkdir(parents=True)
    cache.path(exported).write_bytes(b"weights")
    assert cache.path(exported).name == f"site@{SITE.digest[:12]}.onnx"
    assert cache.holds(exported)
    os.utime(cache.path(exported), (0, 0))
    cache.remember(ModelRegistry(models=[]))
    assert not cache.holds(exported)


async def test_models_are_kept_where_nobody_else_can_write(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    before = os.umask(0)
    try:
        cache = ModelCache(usable_cache(tmp_path / "cache", tmp_path / "spare"))
        await fill(cache)
        cache.remember(ModelRegistry(models=[SITE]))
    finally:
        os.umask(before)
    made = (tmp_path / "cache", cache.folder, cache.path(SITE), cache.folder / "last.json")
    assert [each.stat().st_mode & 0o022 for each in made] == [0, 0, 0, 0]
    cache.path(SITE).chmod(0o664)
    assert not cache.holds(SITE)
    assert f"a cached model that others may write is fetched again: {cache.path(SITE)} can be written by its group" in (
        caplog.text
    )
    await fill(cache)
    assert cache.holds(SITE)
    (cache.folder / "last.json").chmod(0o666)
    assert cache.recall() is None


@pytest.mark.parametrize("which", [".", "models"])
def test_a_cache_that_others_can_write_is_replaced(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, which: str
) -> None:
    cache = tmp_path / "cache"
    assert usable_cache(cache, tmp_path / "spare") == cache
    (cache / which).chmod(0o777)
    assert usable_cache(cache, tmp_path / "spare") == tmp_path / "spare"
    assert (
        f"--cache {cache} is not used: others could exchange its models: {cache / which} can be written" in caplog.text
    )
