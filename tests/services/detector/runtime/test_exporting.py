import errno
import hashlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Self

import pytest

from services.detector.model import ModelError
from services.detector.runtime.engine import BATCH_ON_GPU
from services.detector.runtime.exporting import (
    ABANDONED_S,
    FILES,
    MAKING,
    _without_graphs,
    entry,
    exported,
    installed,
    put_in_place,
    remove_abandoned,
)
from services.detector.runtime.model_file import Task
from services.detector.runtime.offline import keep_offline


def made(folder: Path, content: str) -> Path:
    folder.mkdir()
    (folder / "model.onnx").write_text(content)
    return folder


def test_what_is_put_in_place_is_whole_and_the_first_ones(tmp_path: Path) -> None:
    place = tmp_path / "place"
    put_in_place(made(tmp_path / "one", "first"), place)
    put_in_place(made(tmp_path / "two", "second"), place)
    assert (place / "model.onnx").read_text() == "first"


def test_what_gets_its_place_is_on_the_disk_by_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Path] = []
    monkeypatch.setattr(os, "fsync", lambda file: written.append(Path(f"/proc/self/fd/{file}").readlink()))
    folder = made(tmp_path / "one", "first")
    put_in_place(folder, tmp_path / "place")
    assert written == [folder / "model.onnx", folder]


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


def test_what_a_killed_process_left_behind_is_removed_and_nothing_else(tmp_path: Path) -> None:
    names = (f"{MAKING}old", f"{MAKING}new", ".somebody-elses", "abc-onnx")
    folders = {name: made(tmp_path / name, "") for name in names}
    now_s = folders[f"{MAKING}old"].stat().st_mtime
    for name in names:
        age_s = ABANDONED_S - 1 if name.endswith("new") else ABANDONED_S + 1
        os.utime(folders[name], (now_s - age_s, now_s - age_s))
    remove_abandoned(tmp_path, now_s)
    assert {folder.name for folder in tmp_path.iterdir()} == set(names[1:])
    assert (folders[".somebody-elses"] / "model.onnx").exists()


def test_a_cache_with_nothing_left_behind_stays_as_it_is(tmp_path: Path) -> None:
    remove_abandoned(tmp_path / "absent", 0)
    assert not list(tmp_path.iterdir())


class Exporter:
    """Stands in for Ultralytics' model, and remembers how it was exported. error: what it fails with in the cache."""

    def __init__(self, error: OSError | None = None) -> None:
        self.batches: dict[str, int] = {}
        self.model = SimpleNamespace(model=[None])
        self._error = error
        self._folder = Path()

    def __call__(self, path: Path) -> Self:
        """Load a model."""
        self._folder = path.parent
        return self

    def export(self, *, format: str, batch: int, dynamic: bool, **_: object) -> Path:  # noqa: A002 - theirs
        """Write an empty file."""
        import torch  # noqa: PLC0415 - it is heavy

        assert dynamic
        torch.set_num_threads(1)  # as Ultralytics does, if to another number
        self.batches[format] = batch
        if self._error is not None and "cache" in self._folder.parts:
            raise self._error
        (self._folder / FILES[format]).touch()
        return self._folder / FILES[format]


@pytest.fixture
def export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return what exports `model.pt` as a kind, by an exporter, into a cache; see `exported`."""
    keep_offline(tmp_path / "ultralytics", download=False)
    from ultralytics import models  # noqa: PLC0415

    from services.detector.runtime.weights import Weights  # noqa: PLC0415

    path = tmp_path / "model.pt"
    path.write_bytes(b"weights")
    digest = hashlib.sha256(b"weights").hexdigest()
    weights = Weights(
        path=path, digest=digest, model=None, names={}, task=Task("segment"), longest=640, stride=32, refiner=None
    )

    def export(kind: str, exporter: Exporter, cache: Path = tmp_path / "cache") -> Path:
        monkeypatch.setattr(models, "YOLO", exporter)
        return exported(weights, kind, cache, "cuda:0", 640, gpu="NVIDIA L4", spare=tmp_path / "spare")

    return export


def test_an_engine_is_made_for_as_many_images_at_once_as_it_gets(export: Callable[..., Path]) -> None:
    exporter = Exporter()
    assert [export(kind, exporter).name for kind in FILES] == list(FILES.values())
    assert exporter.batches == {"onnx": 1, "engine": BATCH_ON_GPU}


def test_an_export_leaves_torch_its_threads(export: Callable[..., Path]) -> None:
    import torch  # noqa: PLC0415 - it is heavy

    before = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        export("onnx", Exporter())
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES])
def test_what_cannot_be_written_into_the_cache_goes_elsewhere(
    export: Callable[..., Path], number: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = export("onnx", Exporter(OSError(number, os.strerror(number))))
    assert made.is_relative_to(tmp_path / "spare")
    assert f"--cache {tmp_path / 'cache'}: {os.strerror(number)}: what is exported is not kept" in caplog.text


def test_a_cache_that_cannot_be_looked_into_only_costs_the_keeping(
    export: Callable[..., Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cache = tmp_path / ("x" * 300)
    made = export("onnx", Exporter(), cache)
    assert made.is_relative_to(tmp_path / "spare")
    assert caplog.messages == [f"--cache {cache}: File name too long: what is exported is not kept"]


def test_what_cannot_be_read_in_the_cache_is_made_elsewhere(
    export: Callable[..., Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    theirs = export("onnx", Exporter())
    theirs.unlink()
    theirs.symlink_to(theirs)
    made = export("onnx", Exporter())
    assert made.is_relative_to(tmp_path / "spare")
    assert made.is_file()
    assert "Too many levels of symbolic links: what is exported is not kept" in caplog.text


def test_an_exporter_that_fails_for_another_reason_is_not_the_caches_fault(
    export: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    missing = FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "libnvinfer.so")
    with pytest.raises(ModelError, match=r"cannot be exported for engine: .* No such file or directory: 'libnvinfer"):
        export("engine", Exporter(missing))
    assert "--cache" not in caplog.text


def test_weights_that_were_replaced_since_they_were_loaded_are_not_exported_as_what_they_were(
    export: Callable[..., Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "model.pt").write_bytes(b"other weights")
    with pytest.raises(ModelError, match=r"^model\.pt has been replaced since it was loaded: start again$"):
        export("onnx", Exporter())
    assert not list((tmp_path / "cache").iterdir())
    assert not caplog.messages


EXPORTERS = ("tensorrt 10.3.0", "torch 2.9.0", "ultralytics 8.3.9")


def engine(longest: int = 640, exporters: Sequence[str] = EXPORTERS, gpu: str = "NVIDIA L4") -> str:
    return entry("d" * 64, "engine", longest, exporters, gpu)


def test_an_engine_is_for_one_size_one_gpu_and_one_version_of_what_made_it() -> None:
    newer = ("tensorrt 10.4.0", *EXPORTERS[1:])
    names = {engine(), engine(longest=320), engine(exporters=newer), engine(gpu="NVIDIA A100-SXM4-40GB")}
    assert len(names) == 4
    assert engine() in names, "the same at every start"
    assert entry("e" * 64, "engine", 640, EXPORTERS, "NVIDIA L4") not in names
    assert all(name.endswith("-engine") and len(name) < 100 for name in names)


def test_an_onnx_file_is_for_any_gpu_and_one_version_of_what_made_it() -> None:
    names = {entry("d" * 64, "onnx", 640, EXPORTERS[1:], gpu) for gpu in ("", "NVIDIA L4")}
    assert len(names) == 1
    assert entry("d" * 64, "onnx", 640, ("torch 2.8.0", EXPORTERS[2]), "") not in names


def test_a_package_may_be_installed_under_another_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    about = tmp_path / "fastruntime_gpu-1.2.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: fastruntime-gpu\nVersion: 1.2\n")
    (about / "top_level.txt").write_text("fastruntime\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert installed({"fastruntime", "absent"}) == ["fastruntime-gpu 1.2"]


def test_a_model_that_cannot_be_exported_is_one_line_and_no_graph(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    keep_offline(tmp_path / "ultralytics", download=False)
    from services.detector.runtime.weights import load_weights  # noqa: PLC0415 - it must be offline by then
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - as above

    file = built_models.write(built_models.build("yolov8n-world.yaml"), tmp_path / "world.pt")
    weights = load_weights(str(file))
    with pytest.raises(
        ModelError, match=r"^world\.pt cannot be exported for onnx: Unsupported: ONNX export of [^\n]*$"
    ):
        exported(weights, "onnx", tmp_path / "cache", "cpu", 64, gpu="", spare=tmp_path / "spare")
    assert capfd.readouterr().out == ""


def test_a_torch_that_has_no_switch_for_graphs_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch  # noqa: PLC0415 - it is heavy

    monkeypatch.delattr(torch._C, "_jit_set_onnx_log_enabled")
    with _without_graphs():
        assert not hasattr(torch._C, "_jit_set_onnx_log_enabled")
    assert not hasattr(torch._C, "_jit_set_onnx_log_enabled")
