from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from services.detector.runtime.exporting import put_in_place


def made(folder: Path, content: str) -> Path:
    folder.mkdir()
    (folder / "model.onnx").write_text(content)
    return folder


def test_what_is_put_in_place_is_whole_and_the_first_ones(tmp_path: Path) -> None:
    place = tmp_path / "place"
    put_in_place(made(tmp_path / "one", "first"), place)
    put_in_place(made(tmp_path / "two", "second"), place)
    assert (place / "model.onnx").read_text() == "first"


def test_any_number_at_once(tmp_path: Path) -> None:
    place = tmp_path / "place"
    folders = [made(tmp_path / str(n), str(n)) for n in range(16)]
    with ThreadPoolExecutor(16) as pool:
        list(pool.map(lambda folder: put_in_place(folder, place), folders))
    left = [folder.name for folder in folders if folder.exists()]
    assert len(left) == 15
    assert (place / "model.onnx").read_text() not in left


def test_a_place_that_cannot_be_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        put_in_place(made(tmp_path / "one", "first"), tmp_path / "nowhere" / "place")
