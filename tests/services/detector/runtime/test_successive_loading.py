"""Models that are loaded beside one that runs: nothing is measured then."""

from pathlib import Path

import pytest

from services.detector.model import Model, ModelError
from services.detector.runtime import loading
from services.detector.runtime.loading import SuccessiveLoading, load_all
from services.detector.settings import SHIPPED_MODEL, DetectorSettings


@pytest.fixture(scope="module")
def model(model_folder: Path) -> Model:
    return load_all(DetectorSettings(runtime="torch", cache=model_folder / "cache", refine=False), model_folder)


async def test_later_models_take_the_runtime_of_the_one_before_if_they_work_under_it(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []
    broken: set[tuple[str, str]] = {("b.pt", "torch"), ("c.pt", "torch"), ("c.pt", "auto")}

    def load(settings: DetectorSettings, _: Path) -> Model:
        asked.append((settings.model, settings.runtime))
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
