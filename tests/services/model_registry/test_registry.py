"""What the registry keeps in its folder, and what it refuses."""

import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from schemas.models import MAX_MODELS, PIECE_BYTES, ModelPieceRequest, ModelRegistry, ModelUse
from services.model_registry.folder import UPLOADS, RegistryError
from services.model_registry.registry import Registry, digest_of
from services.model_registry.uploads import MAX_UPLOADS, SPARE_BYTES, UPLOAD_IDLE_S
from tests.services.model_registry.publishing import LONG, model_of, publish, upload


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with closing(Registry(tmp_path)) as made:
        yield made


def use(registry: Registry, digest: str, *robots: str) -> ModelRegistry:
    registry.use(ModelUse(digest=digest, robots=list(robots)))
    return registry.state


def test_a_file_is_published_once_its_last_piece_is_there(registry: Registry, tmp_path: Path) -> None:
    model = model_of(LONG, "site")
    assert registry.take(upload(model, LONG, 1), 0) == [0]
    assert registry.state.models == []
    assert registry.take(upload(model, LONG, 0), 0) == []
    (published,) = registry.state.models
    assert msgspec.structs.replace(published, published_ns=0) == model
    assert published.published_ns > 0
    assert digest_of(tmp_path / f"{model.digest}.pt") == model.digest
    assert list((tmp_path / UPLOADS).iterdir()) == []


def test_the_same_file_again_needs_no_piece(registry: Registry) -> None:
    publish(registry, LONG, "site")
    assert registry.take(upload(model_of(LONG, "other"), LONG), 0) == []
    assert [each.name for each in registry.state.models] == ["site"]


def test_pieces_make_the_file(registry: Registry) -> None:
    model = publish(registry, LONG, "site")
    pieces = [registry.piece(ModelPieceRequest(digest=model.digest, index=index)).data for index in range(2)]
    assert b"".join(pieces) == LONG
    assert len(pieces[0]) == PIECE_BYTES
    with pytest.raises(RegistryError, match="has 2 pieces, and none with index 2"):
        registry.piece(ModelPieceRequest(digest=model.digest, index=2))
    with pytest.raises(RegistryError, match="no published model has the digest"):
        registry.piece(ModelPieceRequest(digest="0" * 64, index=0))


def test_another_content_than_its_digest_is_not_published(registry: Registry, tmp_path: Path) -> None:
    model = model_of(b"true", "site")
    with pytest.raises(RegistryError, match="what arrived has another digest than the file"):
        registry.take(upload(model, b"fake"), 0)
    assert registry.state.models == []
    assert list((tmp_path / UPLOADS).iterdir()) == []
    assert registry.take(upload(model, b"true"), 0) == []


@pytest.mark.parametrize(("index", "content"), [(0, b"short"), (1, LONG), (2, b"beyond"), (0, b"")])
def test_a_piece_of_another_size_is_refused(registry: Registry, index: int, content: bytes) -> None:
    piece = msgspec.structs.replace(upload(model_of(LONG, "site"), LONG), index=index, data=memoryview(content))
    with pytest.raises(RegistryError, match=f"a piece {index} of {len(content)} bytes does not belong to site"):
        registry.take(piece, 0)


def test_a_name_is_one_model_s(registry: Registry) -> None:
    publish(registry, b"one", "site")
    with pytest.raises(RegistryError, match=r"site is the name of site@.*: give this one another \(--name\)"):
        publish(registry, b"two", "site")
    registry.take(upload(model_of(LONG, "next"), LONG), 0)
    with pytest.raises(RegistryError, match="next is the name of"):
        publish(registry, b"two", "next")


def test_few_files_are_half_there_and_idle_ones_give_way(registry: Registry, tmp_path: Path) -> None:
    contents = [LONG + bytes([n]) for n in range(MAX_UPLOADS + 1)]
    for n, content in enumerate(contents[:-1]):
        registry.take(upload(model_of(content, f"m{n}"), content), 0)
    late = upload(model_of(contents[-1], "late"), contents[-1])
    with pytest.raises(RegistryError, match=f"{MAX_UPLOADS} models are being published already"):
        registry.take(late, UPLOAD_IDLE_S)
    registry.end_idle_uploads(UPLOAD_IDLE_S)
    assert len(list((tmp_path / UPLOADS).iterdir())) == MAX_UPLOADS
    registry.end_idle_uploads(UPLOAD_IDLE_S + 1)
    assert list((tmp_path / UPLOADS).iterdir()) == []
    for n, content in enumerate(contents[:-1]):
        registry.take(upload(model_of(content, f"m{n}"), content), 0)
    assert registry.take(late, UPLOAD_IDLE_S + 1) == [1]
    assert len(list((tmp_path / UPLOADS).iterdir())) == 1


def test_beyond_the_limit_the_oldest_that_is_not_in_use_goes(registry: Registry, tmp_path: Path) -> None:
    models = [publish(registry, bytes([n]), f"m{n}") for n in range(MAX_MODELS)]
    use(registry, models[0].digest)
    publish(registry, b"one more", "last")
    assert [each.name for each in registry.state.models] == ["m0", *(f"m{n}" for n in range(2, MAX_MODELS)), "last"]
    assert not (tmp_path / f"{models[1].digest}.pt").exists()
    assert (tmp_path / f"{models[0].digest}.pt").exists()


def test_one_is_in_force_and_one_was_before_and_back_leaves_the_newer_one_for_good(registry: Registry) -> None:
    one, two = (publish(registry, content, content.decode()).digest for content in (b"one", b"two"))
    with pytest.raises(RegistryError, match="no model to go back to"):
        use(registry, "")
    assert use(registry, one).in_force == one
    with pytest.raises(RegistryError, match="no model to go back to"):
        use(registry, "")
    for _ in range(2):  # the second time nothing changes
        state = use(registry, two)
        assert (state.in_force, state.before) == (two, one)
    state = use(registry, "")
    assert (state.in_force, state.before) == (one, "")
    with pytest.raises(RegistryError, match="or going back was done already; fleetsight model use NAME"):
        use(registry, "")
    assert registry.state == state


def test_a_canary_is_beside_the_one_in_force_until_it_is_used_everywhere_or_ended(registry: Registry) -> None:
    one, two = (publish(registry, content, content.decode()).digest for content in (b"one", b"two"))
    with pytest.raises(RegistryError, match="no model is in force: use one for all robots first"):
        use(registry, two, "r1")
    use(registry, one)
    with pytest.raises(RegistryError, match="this model is in force for all robots already"):
        use(registry, one, "r1")
    state = use(registry, two, "r2", "r1", "r2")
    assert (state.in_force, state.canary, state.robots) == (one, two, ["r1", "r2"])
    state = use(registry, "")
    assert (state.in_force, state.before, state.canary, state.robots) == (one, "", "", [])
    use(registry, two, "r1")
    state = use(registry, two)
    assert (state.in_force, state.before, state.canary, state.robots) == (two, one, "", [])
    with pytest.raises(RegistryError, match="no published model has the digest"):
        use(registry, "0" * 64)


def test_going_back_leaves_only_what_is_named_if_something_is(registry: Registry) -> None:
    one, two = (publish(registry, content, content.decode()).digest for content in (b"one", b"two"))
    use(registry, one)
    use(registry, two)
    use(registry, one, "r1")
    with pytest.raises(RegistryError, match=r"two@.* was left meanwhile: now going back would leave one@"):
        registry.use(ModelUse(digest="", leaving=two))
    registry.use(ModelUse(digest="", leaving=one))
    assert (registry.state.in_force, registry.state.canary) == (two, "")
    with pytest.raises(RegistryError, match=r"one@.* was left meanwhile: now going back would leave two@"):
        registry.use(ModelUse(digest="", leaving=one))
    registry.use(ModelUse(digest="", leaving=two))
    assert registry.state.in_force == one


def test_all_is_there_after_a_restart_but_what_was_half_uploaded(registry: Registry, tmp_path: Path) -> None:
    one, two = (publish(registry, content, content.decode()).digest for content in (b"one", b"two"))
    use(registry, one)
    use(registry, two, "r1")
    registry.take(upload(model_of(LONG, "half"), LONG), 0)
    registry.close()
    with closing(Registry(tmp_path)) as again:
        assert again.state == registry.state
        assert list((tmp_path / UPLOADS).iterdir()) == []
        assert again.take(upload(model_of(LONG, "half"), LONG, 1), 0) == [0]


def test_a_state_that_cannot_be_written_is_not_taken(registry: Registry, tmp_path: Path) -> None:
    one, two = (publish(registry, content, content.decode()).digest for content in (b"one", b"two"))
    use(registry, one)
    (tmp_path / "registry.part").mkdir()  # where the new state would be written
    with pytest.raises(RegistryError, match=r"registry.json cannot be written: Is a directory"):
        use(registry, two)
    assert registry.state.in_force == one


def test_a_file_of_a_model_that_cannot_be_noted_does_not_stay(registry: Registry, tmp_path: Path) -> None:
    (tmp_path / "registry.part").mkdir()
    with pytest.raises(RegistryError, match=r"registry.json cannot be written: Is a directory"):
        publish(registry, b"one", "one")
    assert list(tmp_path.glob("*.pt")) == []
    (tmp_path / "registry.part").rmdir()
    publish(registry, b"one", "one")
    assert [each.name for each in registry.state.models] == ["one"]


def test_a_file_for_which_there_is_no_room_is_not_begun(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    free = SPARE_BYTES + 2 * PIECE_BYTES + len(LONG) - 1
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, free))
    registry.take(upload(model_of(LONG, "site"), LONG), 0)
    other = LONG + b"!"
    with pytest.raises(RegistryError, match=r"other has 1.6 MB, and the disk of .* has room for 1.0 MB: make room"):
        publish(registry, other * 3, "other")
    publish(registry, LONG, "site")
    assert [each.name for each in registry.state.models] == ["site"]
