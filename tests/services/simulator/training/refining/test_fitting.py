from pathlib import Path

import numpy as np
import pytest
import torch

from services.detector.runtime.refinement.network import RefinerNetwork
from services.simulator.training.refining.fitting import BATCH, LAST_RATE, RATE, WARM_UP, fit_refiner, rate
from services.simulator.training.refining.samples import Samples
from services.simulator.training.settings import TrainingSettings


class Interrupted(Exception):  # noqa: N818 - what an interruption is, not an error
    """Stops a run from within its progress report."""


def shifted() -> Samples:
    """Return squares whose coarse masks are all too far to the left, as anybody can see in the picture."""
    rng = np.random.default_rng(1)
    pixels, targets = np.zeros((2 * BATCH, 16, 16, 6), np.uint8), np.zeros((2 * BATCH, 16, 16), np.uint8)
    for n, (top, left) in enumerate(rng.integers(0, 8, (2 * BATCH, 2)).tolist()):
        targets[n, top : top + 6, left + 2 : left + 8] = 255
        pixels[n, ..., :3] = targets[n, ..., None]
        pixels[n, top : top + 6, left : left + 6, 3] = 255
    return Samples(pixels, np.zeros((2 * BATCH, 8, 8, 1), np.float16), np.zeros(2 * BATCH, np.int64), targets)


def settings(folder: Path, epochs: int) -> TrainingSettings:
    folder.mkdir(exist_ok=True)
    return TrainingSettings(refiner_epochs=epochs, device="cpu", workers=1, work_dir=folder)


def network() -> RefinerNetwork:
    torch.manual_seed(1)
    return RefinerNetwork(1, 1)


def overlap(of: RefinerNetwork, samples: Samples) -> float:
    with torch.inference_mode():
        odds = of.eval()(*map(torch.from_numpy, (samples.pixels, samples.features, samples.labels)))
    masks, truths = odds.numpy() > 0, samples.targets > 127
    return float(np.mean(np.sum(masks & truths, (1, 2)) / np.sum(masks | truths, (1, 2))))


def test_a_network_learns_where_masks_should_be(tmp_path: Path) -> None:
    learning, samples = network(), shifted()
    assert overlap(learning, samples) < 0.6
    steps: list[tuple[str, int, int]] = []
    fit_refiner(learning, samples, settings=settings(tmp_path, 20), progress=lambda *report: steps.append((*report,)))
    assert overlap(learning, samples) > 0.8
    assert steps == [("train refiner", step, 40) for step in range(1, 41)]


def test_what_was_interrupted_goes_on_and_ends_as_it_would_have(tmp_path: Path) -> None:
    samples, whole, halted, resumed = shifted(), network(), network(), RefinerNetwork(1, 1)
    fit_refiner(whole, samples, settings=settings(tmp_path / "whole", 3), progress=lambda *_: None)

    def interrupt(_stage: str, step: int, _steps: int) -> None:
        if step == 4:
            raise Interrupted

    with pytest.raises(Interrupted):
        fit_refiner(halted, samples, settings=settings(tmp_path / "parts", 3), progress=interrupt)
    steps: list[int] = []
    fit_refiner(
        resumed, samples, settings=settings(tmp_path / "parts", 3), progress=lambda _, step, __: steps.append(step)
    )
    assert steps == [3, 4, 5, 6]
    for name, value in whole.state_dict().items():
        assert torch.allclose(resumed.state_dict()[name], value, atol=1e-6), name


def test_the_rate_rises_and_falls_again() -> None:
    risen = round(1000 * WARM_UP)
    assert rate(0, 1000) == pytest.approx(RATE / risen, rel=0.01)
    assert rate(risen, 1000) == pytest.approx(RATE, rel=0.01)
    assert rate(999, 1000) == pytest.approx(LAST_RATE, rel=0.01)
    assert all(rate(step, 1000) > rate(step + 1, 1000) for step in range(risen, 999))
