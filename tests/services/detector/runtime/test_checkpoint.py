"""Exactly the file that is named is the model, and one that is none is refused in one line that says what to do."""

import collections
import sys
import threading
import zipfile
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from services.detector.model import ModelError
from services.detector.runtime.loading import load
from services.detector.runtime.pipeline import Pipeline
from services.detector.settings import DetectorSettings

pytestmark = pytest.mark.usefixtures("shut_network")


@pytest.fixture(scope="module")
def built(model_folder: Path) -> Any:
    """Return a module that finds objects, by class 0 to 3."""
    from services.detector.runtime.offline import keep_offline  # noqa: PLC0415

    keep_offline(model_folder / "ultralytics", download=False)
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - after `keep_offline`

    return built_models.build("yolov5n.yaml")


@pytest.fixture(autouse=True)
def own_names(built: Any) -> Iterator[None]:
    """Undo what tests do to the names of the model that they share."""
    yield
    built.names = {label: str(label) for label in range(4)}


def written(model: Any, file: Path, **entries: object) -> Path:
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - after `keep_offline`

    file.parent.mkdir(parents=True, exist_ok=True)
    return built_models.write(model, file, **entries)


def loaded(file: Path | str, folder: Path, **fields: object) -> Pipeline:
    chosen = {"model": str(file), "runtime": "torch", "device": "cpu", "cache": folder / "cache", **fields}
    model = load(DetectorSettings.model_validate(chosen), folder / "ultralytics")
    model.close()
    return model


def refusal(file: Path, folder: Path) -> str:
    with pytest.raises(ModelError) as refused:
        loaded(file, folder)
    said = str(refused.value)
    assert "\n" not in said
    begin = f"--model {file}: not a model that can be used: "
    assert said.startswith(begin)
    return said.removeprefix(begin)


@pytest.mark.parametrize(
    "name", ["yolov5s.pt", "yolov5n6.pt", "yolov3-tiny.pt", "it's mine.pt", "it's/yolov3.pt", " yolo26n.pt", "X.PT"]
)
def test_the_file_that_is_named_is_the_model_whatever_its_name(
    name: str, built: Any, tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written(built, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert loaded(name, model_folder).name == file.name
    assert loaded(file, model_folder, download=True).name == file.name


def test_a_file_of_the_name_that_ultralytics_would_make_of_it_is_another_model(
    built: Any, tmp_path: Path, model_folder: Path
) -> None:
    file = written(built, tmp_path / "yolov5s.pt")
    (tmp_path / "yolov5su.pt").write_bytes(b"another model")
    written(built, tmp_path / "its.pt").write_bytes(b"another model")
    assert loaded(file, model_folder).name == "yolov5s.pt"
    assert loaded(file.rename(tmp_path / "it's.pt"), model_folder).name == "it's.pt"


def test_what_is_exported_is_the_file_that_is_named_whatever_the_cache_is_called(
    built: Any, tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written(built, tmp_path / "yolov5s.pt")
    monkeypatch.chdir(tmp_path)
    for cache in (tmp_path / "it's", Path(" http:")):
        assert loaded(file, model_folder, runtime="onnx", cache=cache).facts.runtime == "onnx"
        assert len(list(cache.rglob("model.onnx"))) == 1


def test_weights_that_are_not_here_are_asked_for_only_where_that_is_allowed(
    tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch, built: Any
) -> None:
    from ultralytics.utils import downloads  # noqa: PLC0415 - after `keep_offline`

    asked: list[str] = []

    def fetch(name: object, **_: object) -> str:
        asked.append(str(name))
        return str(written(built, tmp_path / "fetched" / "yolov5su.pt"))

    monkeypatch.setattr(downloads, "attempt_download_asset", fetch)
    monkeypatch.chdir(tmp_path)
    assert loaded("yolov5s.pt", model_folder, download=True).name == "yolov5su.pt"
    assert asked == ["yolov5s.pt"]


@pytest.mark.parametrize(
    "names",
    [
        ["a", "b", "c", "d"],
        ("a", "b", "c", "d"),
        {3: "d", 2: "c", 1: "b", 0: "a"},
        {0.0: "a", 1.0: "b", 2.0: "c", 3.0: "d"},
        {"0": "a", "1": "b", "2": "c", "3": "d"},
        {np.int64(0): "a", np.int64(1): "b", np.int64(2): "c", np.int64(3): "d"},
    ],
)
def test_classes_may_be_renamed_by_a_list(names: object, built: Any, tmp_path: Path, model_folder: Path) -> None:
    built.names = names
    model = loaded(written(built, tmp_path / "renamed.pt"), model_folder)
    assert dict(model.facts.names) == {0: "a", 1: "b", 2: "c", 3: "d"}


def test_half_a_character_in_a_classs_name_is_its_escape(built: Any, tmp_path: Path, model_folder: Path) -> None:
    built.names = ["a\udcffb", "Kartön", "c", "d"]
    model = loaded(written(built, tmp_path / "half.pt"), model_folder)
    assert list(model.facts.names.values())[:2] == [r"a\udcffb", "Kartön"]


@pytest.mark.parametrize(
    ("names", "wrong"),
    [
        (["a"], "1 names for 4 classes"),
        (list("abcdef"), "6 names for 4 classes"),
        ({1: "a", 2: "b", 3: "c", 4: "d"}, "names of other classes"),
        ({"a": 0, "b": 1, "c": 2, "d": 3}, "names of other classes"),
        ({0: "a", 1: "b", 2: "c", 2.5: "d"}, "names of other classes"),
        ({0: "a", "0": "b", 1: "c", 2: "d"}, "names of other classes"),
        ({"a", "b", "c", "d"}, "its names are a set, neither a list nor a dictionary"),
        ("abcd", "its names are a str, neither a list nor a dictionary"),
        ("", "its names are a str, neither a list nor a dictionary"),
        (["a", "", "c", "d"], "class 1 has an empty name"),
        ({0: "a", 1: "b", 2: " ", 3: "d"}, "class 2 has an empty name"),
    ],
)
def test_names_that_are_not_one_for_each_class(
    names: object, wrong: str, built: Any, tmp_path: Path, model_folder: Path
) -> None:
    built.names = names
    said = refusal(written(built, tmp_path / "few.pt"), model_folder)
    assert said == f"{wrong}: give its model one name for each class, numbered from 0, and save it again"


def test_numbers_of_numpy_are_data(built: Any, tmp_path: Path, model_folder: Path) -> None:
    kinds = (np.float16, np.float32, np.float64, np.int32, np.int64, np.uint8, np.bool_)
    values = [*(kind(1) for kind in kinds), np.str_("x")]
    loaded(written(built, tmp_path / "numbers.pt", results=values), model_folder)


def test_a_type_that_is_no_data_is_named(built: Any, tmp_path: Path, model_folder: Path) -> None:
    file = written(built, tmp_path / "more.pt", note=collections.UserDict(a=1))
    assert refusal(file, model_folder) == (
        "it holds collections.UserDict, which would be executed: save it again without, with numbers, texts and tensors"
        " alone"
    )


@pytest.mark.parametrize("archive", [True, False])
def test_the_first_yolov5_is_explained_as_ultralytics_does(
    *, archive: bool, tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import torch  # noqa: PLC0415 - after `keep_offline`

    kind = type("Model", (), {"__module__": "models.yolo"})
    module = ModuleType("models.yolo")
    vars(module)["Model"] = kind
    with monkeypatch.context() as there:
        there.setitem(sys.modules, "models", ModuleType("models"))
        there.setitem(sys.modules, "models.yolo", module)
        torch.save({"model": kind()}, tmp_path / "yolov5s.pt", _use_new_zipfile_serialization=archive)
    said = refusal(tmp_path / "yolov5s.pt", model_folder)
    assert said.startswith("it appears to be an Ultralytics YOLOv5 model originally trained with https://github.com/")
    assert said.endswith("train a new model with that package, or take a published one, such as yolov5su.pt")


@pytest.mark.parametrize("channels", [1, 4])
def test_a_model_of_images_of_other_channels(channels: int, tmp_path: Path, model_folder: Path) -> None:
    from ultralytics.nn.tasks import DetectionModel  # noqa: PLC0415 - after `keep_offline`

    file = written(DetectionModel("yolov5n.yaml", ch=channels, verbose=False), tmp_path / "grey.pt")
    assert refusal(file, model_folder) == (
        f"it is for images of {channels} channels, and cameras have 3: train it on RGB"
    )


@pytest.mark.parametrize(
    "content", [b"<!DOCTYPE html>" * 50, b"version https://git-lfs.github.com/spec/v1\noid sha256:aa\nsize 5\n"]
)
def test_a_page_or_a_pointer_instead_of_the_file_is_not_written_by_torch(
    content: bytes, tmp_path: Path, model_folder: Path
) -> None:
    (tmp_path / "page.pt").write_bytes(content)
    assert refusal(tmp_path / "page.pt", model_folder) == "damaged, or not written by torch"


def test_a_file_without_a_model_says_what_it_holds_instead(tmp_path: Path, model_folder: Path, built: Any) -> None:
    import torch  # noqa: PLC0415 - after `keep_offline`

    state = built.state_dict()
    first, second, third = list(state)[:3]
    for content, held in (
        (state, f"only {first} (Tensor), {second} (Tensor), {third} (Tensor), ..."),
        ({"state_dict": dict(state), "epoch": 3}, "only state_dict (dict), epoch (int)"),
        ({"model": dict(state)}, "only model (dict)"),
        ({"model": None}, "only model (NoneType)"),
        ({"a\nb": 1}, "only a\\nb (int)"),
        ({}, "it is empty"),
        ([1, 2], "only a list"),
        (torch.zeros(3), "only a Tensor"),
    ):
        torch.save(content, tmp_path / "part.pt")
        assert refusal(tmp_path / "part.pt", model_folder) == (
            f"it holds no model, {held}: save the whole checkpoint, as Ultralytics' model.save() does"
        )


def test_ultralytics_looks_for_files_as_before_once_loads_that_overlap_are_done(built: Any) -> None:
    from services.detector.runtime.checkpoint import exact_names  # noqa: PLC0415 - after `keep_offline`

    del built  # it has imported Ultralytics offline
    from ultralytics.utils import downloads  # noqa: PLC0415 - as above

    theirs = downloads.attempt_download_asset
    entered, left = threading.Event(), threading.Event()

    def load_too() -> None:
        with exact_names():
            entered.set()
            left.wait(10)

    other = threading.Thread(target=load_too)
    with exact_names():
        other.start()
        entered.wait(0.2)
    left.set()
    other.join()
    assert entered.is_set()
    assert downloads.attempt_download_asset is theirs


def test_what_is_said_of_a_file_names_it_once(tmp_path: Path, model_folder: Path) -> None:
    (tmp_path / "empty.pt").write_bytes(b"")
    said = refusal(tmp_path / "empty.pt", model_folder)
    assert said.startswith("it is not a loadable checkpoint")


def test_a_small_file_that_unpacks_to_gigabytes_is_not_loaded(
    tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = tmp_path / "bomb.pt"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data/0", bytes(64 << 20))
    assert bomb.stat().st_size < 100_000
    monkeypatch.setattr("services.detector.runtime.checkpoint.MOST_BYTES", 32 << 20)
    with pytest.raises(ModelError, match=r"it has 67108864 bytes unpacked, at most 33554432 are loaded$"):
        load(DetectorSettings(connect=["tcp/127.0.0.1:7447"], model=str(bomb)), model_folder)


def test_a_small_file_whose_tensors_stand_for_gigabytes_is_not_loaded(
    built: Any, tmp_path: Path, model_folder: Path
) -> None:
    import torch  # noqa: PLC0415 - after `keep_offline`

    bomb, file = deepcopy(built).half(), tmp_path / "bomb.pt"
    bomb.register_buffer("large", torch.zeros(1, dtype=torch.half).expand(1 << 40))
    torch.save({"model": bomb}, file)
    assert refusal(file, model_folder) == "it has a tensor of 2199023255552 bytes of which 2 are in the file"
