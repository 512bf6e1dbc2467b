"""Models that are loaded beside one that runs: nothing is measured then."""

from copy import copy
from dataclasses import replace
from pathlib import Path

import onnx
import pytest

from services.detector.model import Model, ModelError
from services.detector.pairing import PairedModel
from services.detector.runtime import loading
from services.detector.runtime.exported_model import INT8
from services.detector.runtime.loading import SuccessiveLoading, load_all
from services.detector.runtime.pipeline import Pipeline
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL, DetectorSettings


@pytest.fixture(scope="module")
def model(model_folder: Path) -> Model:
    return load_all(DetectorSettings(runtime="torch", cache=model_folder / "cache", refine=False), model_folder)


def under(runtime: str, model: Model) -> Model:
    """Return a model that says that it runs under a runtime."""
    assert isinstance(model, Pipeline)
    said = copy(model)
    said.facts = replace(model.facts, runtime=runtime)
    return said


async def test_later_models_take_the_runtime_of_the_first_if_they_work_under_it(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []
    broken: set[tuple[str, str]] = {("b.pt", "torch"), ("c.pt", "torch"), ("c.pt", "auto")}

    def load(settings: DetectorSettings, _: Path, as_before: str | None = None) -> Model:
        asked.append((settings.model, as_before or settings.runtime))
        if asked[-1] in broken:
            raise ModelError(f"{asked[-1]} does not work")
        return model

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="auto"), tmp_path)
    for weights in ("a.pt", "a2.pt", "b.pt"):
        assert successive.load(Path(weights)) is model
    with pytest.raises(ModelError, match="'auto'"):
        successive.load(Path("c.pt"))
    assert asked == [
        ("a.pt", "auto"),
        ("a2.pt", "torch"),
        ("b.pt", "torch"),
        ("b.pt", "auto"),
        ("c.pt", "torch"),
        ("c.pt", "auto"),
    ]


async def test_a_model_that_works_under_another_runtime_alone_changes_none_of_later_ones(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []

    def load(settings: DetectorSettings, _: Path, as_before: str | None = None) -> Model:
        asked.append((settings.model, as_before or settings.runtime))
        if asked[-1] == ("b.pt", "onnx"):
            raise ModelError("it cannot be exported")
        return under("torch" if settings.model == "b.pt" else "onnx", model)

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="auto"), tmp_path)
    for weights in ("a.pt", "b.pt", "c.pt"):
        successive.load(Path(weights))
    assert asked == [("a.pt", "auto"), ("b.pt", "onnx"), ("b.pt", "auto"), ("c.pt", "onnx")]


async def test_a_model_without_int8_networks_runs_under_the_same_library_also_beside_one_with_them(
    model_folder: Path, tmp_path: Path
) -> None:
    without = onnx.load(SHIPPED_EXPORT)
    (int8,) = (each for each in without.metadata_props if each.key == INT8)
    without.metadata_props.remove(int8)
    onnx.save(without, tmp_path / "without.onnx")
    chosen = {"model": str(SHIPPED_EXPORT), "device": "cpu", "refine": False, "cache": tmp_path / "cache"}
    boxes = {**chosen, "detection_model": str(tmp_path / "without.onnx")}
    pair = load_all(DetectorSettings.model_validate(boxes), model_folder, as_before="openvino-int8")
    assert pair.runtime == "openvino+openvino-int8"
    pair.close()


async def test_a_later_model_that_does_not_run_as_the_first_did_is_told(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def load(settings: DetectorSettings, _: Path, as_before: str | None = None) -> Model:
        if as_before is not None:
            raise ModelError(f"{settings.model}: its INT8 network is damaged")
        return under("openvino-int8", model)

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="auto"), tmp_path)
    for file in ("a.onnx", "b.onnx"):
        successive.load(Path(file))
    assert caplog.messages == ["not under openvino-int8, as the model before it: b.onnx: its INT8 network is damaged"]


async def test_beside_a_model_for_boxes_the_runtime_is_that_of_the_models_that_change(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def load(settings: DetectorSettings, _: Path, as_before: str | None = None) -> Model:
        asked.append(as_before or settings.runtime)
        return PairedModel(under("torch", model), under("onnx", model))

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="auto"), tmp_path)
    for weights in ("a.pt", "b.pt"):
        successive.load(Path(weights))
    assert asked == ["auto", "onnx"]


async def test_a_runtime_that_was_asked_for_is_that_of_all(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load(settings: DetectorSettings, _: Path) -> Model:
        assert settings.runtime == "torch"
        if settings.model != str(SHIPPED_MODEL):
            raise ModelError("it does not work")
        return model

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="torch"), tmp_path)
    assert successive.load(SHIPPED_MODEL) is model
    with pytest.raises(ModelError, match="it does not work"):
        successive.load(Path("other.pt"))


async def test_the_first_of_the_other_form_is_not_measured_beside_a_model_that_runs(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []

    def load(settings: DetectorSettings, _: Path, as_before: str | None = None) -> Model:
        asked.append((settings.model, as_before or settings.runtime))
        return under(as_before or "openvino", model)

    monkeypatch.setattr(loading, "load_all", load)
    successive = SuccessiveLoading(DetectorSettings(runtime="auto"), tmp_path)
    for file in ("a.onnx", "b.pt", "c.onnx", "d.pt"):
        successive.load(Path(file))
    assert asked == [("a.onnx", "auto"), ("b.pt", "torch"), ("c.onnx", "openvino"), ("d.pt", "torch")]
