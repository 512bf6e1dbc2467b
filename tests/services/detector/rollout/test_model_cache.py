"""Published models on a worker's machine: only whole files with the right digest are used."""

import asyncio
from pathlib import Path

import pytest

from schemas.models import ModelRegistry
from services.detector.model_cache import DamagedModelError, ModelCache
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


async def test_neither_another_file_nor_half_of_one_is_kept(tmp_path: Path) -> None:
    cache = ModelCache(tmp_path)
    with pytest.raises(DamagedModelError, match="has another digest than what was published"):
        await fill(cache, b"WEIGHTS")

    async def fail(file: Path) -> None:
        await asyncio.to_thread(file.write_bytes, b"wei")
        raise TimeoutError

    with pytest.raises(TimeoutError):
        await cache.fill(SITE, fail)
    assert list(cache.folder.iterdir()) == []


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
    assert cache.holds(SITE)
    cache.remember(ModelRegistry(models=[]))
    assert not cache.holds(SITE)


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
