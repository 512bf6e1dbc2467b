"""Changes of files that a session was opened with."""

from pathlib import Path

from bus.session.changed_files import ChangedFiles


def test_a_change_counts_once_nobody_writes_any_more(tmp_path: Path) -> None:
    file = tmp_path / "r1.pem"
    file.write_text("one")
    files = ChangedFiles([None, file])
    assert not files.changed()
    file.write_text("another")
    assert not files.changed(), "it may still be written"
    file.write_text("another one")
    assert not files.changed()
    assert files.changed()
    assert files.changed(), "until it is used"
    files.use()
    assert not files.changed()


def test_a_file_that_is_gone_and_back_as_it_was_is_another_one(tmp_path: Path) -> None:
    file = tmp_path / "r1.pem"
    files = ChangedFiles([file])
    assert not files.changed()
    file.write_text("one")
    assert [files.changed(), files.changed()] == [False, True]


def test_a_right_that_changes_is_a_change(tmp_path: Path) -> None:
    file = tmp_path / "r1.key"
    file.write_text("key")
    files = ChangedFiles([file])
    file.chmod(0o600)
    assert [files.changed(), files.changed()] == [False, True]


def test_without_files_nothing_changes() -> None:
    files = ChangedFiles([None, None])
    assert not files
    assert not files.changed()
