"""Exported models are loaded only where nobody else can have put or changed them."""

from __future__ import annotations

import os
import shutil
import stat
from typing import TYPE_CHECKING

import pytest

from services.detector.model import ModelError
from services.detector.runtime.exported_model import read_exported
from services.detector.runtime.exporting import DIGEST
from services.detector.settings import SHIPPED_EXPORT
from tests.services.detector.runtime.test_exporting import Exporter, export

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

__all__ = ["export"]


@pytest.fixture(autouse=True)
def _careless() -> Iterator[None]:
    """Let everybody write what this process makes, unless it says otherwise."""
    before = os.umask(0)
    yield
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def give_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Make a file another user's, and return who that is."""
    if os.geteuid() == 0:
        os.chown(path, 4242, -1)
        return 4242
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    return mine


def test_what_is_exported_is_written_by_no_other_user(export: Callable[..., Path]) -> None:
    file = export("onnx", Exporter())
    cache = file.parent.parent
    assert [mode(each) & 0o022 for each in (cache, file.parent, file, file.parent / DIGEST)] == [0, 0, 0, 0]
    assert mode(file) & 0o444 == 0o444, "others may read it, as before"
    assert export("onnx", Exporter()) == file, "it is used again"


@pytest.mark.parametrize(("bits", "who"), [(0o020, "its group"), (0o002, "everybody")])
@pytest.mark.parametrize("of", ["cache", "entry", "file"])
def test_what_others_can_write_is_refused_with_the_cure(
    export: Callable[..., Path], bits: int, who: str, of: str
) -> None:
    file = export("onnx", Exporter())
    path = {"cache": file.parent.parent, "entry": file.parent, "file": file}[of]
    path.chmod(mode(path) | bits)
    exporter = Exporter()
    with pytest.raises(ModelError) as refused:
        export("onnx", exporter)
    recursive = "" if of == "file" else "-R "
    assert str(refused.value) == (
        f"--cache {file.parent.parent}: others could exchange its models: {path} can be written by {who}"
        f" (mode {mode(path):o}): chmod {recursive}go-w {path}"
    )
    assert not exporter.batches, "nor is anything made there"
    path.chmod(mode(path) & ~0o022)
    assert export("onnx", exporter) == file


@pytest.mark.parametrize("of", ["cache", "entry", "file"])
def test_what_another_user_owns_is_refused(
    export: Callable[..., Path], of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = export("onnx", Exporter())
    path = {"cache": file.parent.parent, "entry": file.parent, "file": file}[of]
    uid = give_away(path, monkeypatch)
    with pytest.raises(ModelError, match=rf"belongs to another user \(uid {uid}\): give a folder of your own$"):
        export("onnx", Exporter())


def changed(file: Path) -> None:
    file.write_text("another model")


def taken_from_another(file: Path) -> None:
    other = file.parent.parent / "another-entry"
    shutil.copytree(file.parent, other)
    (other / DIGEST).write_text((other / DIGEST).read_text().replace(file.parent.name, other.name))
    shutil.rmtree(file.parent)
    other.rename(file.parent)


def without_digest(file: Path) -> None:
    (file.parent / DIGEST).unlink()


@pytest.mark.parametrize("spoil", [changed, taken_from_another, without_digest])
def test_what_is_not_as_it_was_kept_is_exported_again(
    export: Callable[..., Path], spoil: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    file = export("onnx", Exporter())
    spoil(file)
    exporter = Exporter()
    assert export("onnx", exporter) == file
    assert exporter.batches == {"onnx": 1}
    assert file.read_bytes() == b""
    assert f"{file}: its SHA-256 is not the recorded one; exporting again" in caplog.messages
    assert export("onnx", exporter := Exporter()) == file
    assert not exporter.batches


def test_a_model_that_is_named_is_read_with_a_warning_where_everybody_may_write_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "named.onnx"
    shutil.copyfile(SHIPPED_EXPORT, file)
    for bits, warned in ((0o664, 0), (0o666, 1)):
        file.chmod(bits)
        read_exported(str(file))
        assert caplog.text.count(f"everybody on this machine could exchange the model: chmod o-w {file}") == warned
