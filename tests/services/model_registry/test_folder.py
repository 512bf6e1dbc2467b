"""A registry's folder that is damaged, used by two, or loses its power."""

import os
from contextlib import closing
from pathlib import Path

import pytest

from schemas.models import ModelRegistry, ModelUse
from services.model_registry.folder import DAMAGED_FILE, STATE_FILE, FolderInUseError, ModelFolder, RegistryError
from services.model_registry.registry import Registry
from tests.services.model_registry.publishing import publish


@pytest.fixture
def one(tmp_path: Path) -> str:
    """Publish `two`, put `one` in force, and end; return the digest of `one`."""
    with closing(Registry(tmp_path)) as registry:
        publish(registry, b"two", "two")
        digest = publish(registry, b"one", "one").digest
        registry.use(ModelUse(digest=digest))
    return digest


@pytest.mark.parametrize("content", [b"", b"{", b'{"models": [{"digest": "x"}]}', b"\xff"])
def test_a_damaged_state_is_put_aside_and_told_until_a_model_is_in_force(
    one: str, tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / STATE_FILE).write_bytes(content)
    for _ in range(2):  # it is told after a restart too
        caplog.clear()
        with closing(Registry(tmp_path)) as registry:
            assert registry.state == ModelRegistry(models=[])
            assert (tmp_path / DAMAGED_FILE).read_bytes() == content
            (problem,) = registry.problems
        assert f"{STATE_FILE} was damaged" in problem
        assert [(each.levelname, each.getMessage()) for each in caplog.records] == [("ERROR", problem)]
    with closing(Registry(tmp_path)) as registry:
        publish(registry, b"one", "one")
        assert registry.problems
        registry.use(ModelUse(digest=one))
        assert registry.problems == ()


@pytest.mark.parametrize(
    ("content", "why"), [(None, "is gone"), (b"on", "has 2 bytes instead of 3"), (b"off", "another digest")]
)
def test_a_model_whose_file_is_lost_or_damaged_is_withdrawn_until_its_file_is_restored(
    one: str, tmp_path: Path, content: bytes | None, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / f"{one}.pt"
    file.unlink() if content is None else file.write_bytes(content)
    with closing(Registry(tmp_path)) as registry:
        withdraw_damaged(registry)
        assert ([each.name for each in registry.state.models], registry.state.in_force) == (["two"], "")
        (problem,) = registry.problems
    assert f"one@{one[:12]}, which was in force, is withdrawn" in problem
    assert why in problem
    assert [each.getMessage() for each in caplog.records if each.levelname == "ERROR"] == [problem]
    file.write_bytes(b"one")
    with closing(Registry(tmp_path)) as registry:
        withdraw_damaged(registry)
        assert (registry.state.in_force, registry.problems) == (one, ())


def withdraw_damaged(registry: Registry) -> None:
    for model in registry.state.models:
        if found := registry.why_damaged(model):
            registry.withdraw(model.digest, found)


def test_a_lost_model_is_no_problem_once_it_is_published_again_or_another_is_in_force(one: str, tmp_path: Path) -> None:
    for mend in (
        lambda registry: publish(registry, b"one", "one"),
        lambda registry: registry.use(ModelUse(digest=registry.state.models[0].digest)),
    ):
        (tmp_path / f"{one}.pt").unlink()
        with closing(Registry(tmp_path)) as registry:
            assert registry.problems
            mend(registry)
            assert registry.problems == ()
            registry.use(ModelUse(digest=registry.state.models[-1].digest))


def test_a_canary_whose_file_is_lost_ends(one: str, tmp_path: Path) -> None:
    with closing(Registry(tmp_path)) as registry:
        two = registry.state.models[0].digest
        registry.use(ModelUse(digest=two, robots=["r1"]))
    (tmp_path / f"{two}.pt").unlink()
    with closing(Registry(tmp_path)) as registry:
        assert (registry.state.in_force, registry.state.canary, registry.state.robots) == (one, "", [])


def test_a_folder_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RegistryError, match=r"--models .*/file: File exists"):
        Registry(tmp_path / "file")
    (tmp_path / STATE_FILE).mkdir()
    with pytest.raises(RegistryError, match=r"--models .*: Is a directory"):
        Registry(tmp_path)
    (tmp_path / STATE_FILE).rmdir()
    Registry(tmp_path).close()  # the failure kept no lock


def test_a_folder_is_one_process_s(tmp_path: Path) -> None:
    folder = ModelFolder(tmp_path)
    with pytest.raises(FolderInUseError, match="another process serves this folder: give one monitor --models"):
        ModelFolder(tmp_path)
    folder.close()
    ModelFolder(tmp_path).close()


def test_a_state_is_on_the_disk_before_and_after_it_gets_its_name(
    one: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[tuple[Path, bool]] = []

    def sync(descriptor: int) -> None:
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        synced.append((path, (tmp_path / "registry.part").exists()))

    with closing(Registry(tmp_path)) as registry:
        monkeypatch.setattr(os, "fsync", sync)
        registry.use(ModelUse(digest=registry.state.models[0].digest))
        assert registry.state.before == one
    assert synced == [(tmp_path / "registry.part", True), (tmp_path, False)]
