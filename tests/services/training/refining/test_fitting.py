from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from services.detector.runtime.refinement.network import RefinerNetwork
from services.training.files import TrainingError
from services.training.refining.fitting import BATCH, LAST_RATE, RATE, WARM_UP, drawn, fit_refiner, rate
from services.training.refining.samples import SEEN, Samples
from services.training.settings import TrainingSettings


class Interrupted(Exception):  # noqa: N818 - what an interruption is, not an error
    """Stops a run from within its progress report."""


SIDE = 16
KIND = np.dtype(
    [
        ("pixels", np.uint8, (SIDE, SIDE, 6)),
        ("features", np.float16, (SIDE // 2, SIDE // 2, 1)),
        ("labels", np.int64),
        ("scores", np.float32),
        ("targets", np.uint8, (SIDE, SIDE)),
    ]
)


@pytest.fixture
def shifted(tmp_path: Path) -> Samples:
    """Return squares whose coarse masks are all too far to the left, as anybody can see in the picture.

    Of every fourth there is nothing to be seen.
    """
    rng = np.random.default_rng(1)
    samples = np.zeros(2 * BATCH, KIND)
    samples["scores"] = 0.5
    for n, (top, left) in enumerate(rng.integers(0, 8, (2 * BATCH, 2)).tolist()):
        samples["pixels"][n, top : top + 6, left : left + 6, 3] = 255
        if n % 4:
            samples["targets"][n, top : top + 6, left + 2 : left + 8] = 255
            samples["pixels"][n, ..., :3] = samples["targets"][n, ..., None]
    np.save(tmp_path / "shifted.npy", samples)
    return Samples([tmp_path / "shifted.npy"])


def settings(folder: Path, epochs: int, workers: int = 1) -> TrainingSettings:
    folder.mkdir(exist_ok=True)
    return TrainingSettings(refiner_epochs=epochs, device="cpu", workers=workers, work_dir=folder)


def network() -> RefinerNetwork:
    torch.manual_seed(1)
    return RefinerNetwork(1, 1)


def judged(of: RefinerNetwork, samples: Samples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the IoU of each mask, and the one that the network expects."""
    batch = samples.take(np.arange(len(samples.labels)))
    with torch.inference_mode():
        odds, quality = of.eval()(*(torch.from_numpy(np.ascontiguousarray(batch[name])) for name in SEEN))
    masks, truths = odds.numpy() > 0, batch["targets"] > 127
    return np.sum(masks & truths, (1, 2)) / np.sum(masks | truths, (1, 2)), quality.sigmoid().numpy()


def test_a_network_learns_where_masks_should_be_and_which_are_of_nothing(tmp_path: Path, shifted: Samples) -> None:
    learning = network()
    there = np.arange(2 * BATCH) % 4 > 0
    assert judged(learning, shifted)[0][there].mean() < 0.6
    steps: list[tuple[str, int, int]] = []
    fit_refiner(learning, shifted, settings=settings(tmp_path, 20), progress=lambda *report: steps.append((*report,)))
    found, expected = judged(learning, shifted)
    assert found[there].mean() > 0.8
    assert expected[there].min() > 2 * expected[~there].max()
    assert steps == [("train refiner", step, 40) for step in range(1, 41)]


def test_what_was_interrupted_goes_on_and_ends_as_it_would_have(tmp_path: Path, shifted: Samples) -> None:
    whole, halted, resumed = network(), network(), RefinerNetwork(1, 1)
    fit_refiner(whole, shifted, settings=settings(tmp_path / "whole", 3), progress=lambda *_: None)

    def interrupt(_stage: str, step: int, _steps: int) -> None:
        if step == 4:
            raise Interrupted

    with pytest.raises(Interrupted):
        fit_refiner(halted, shifted, settings=settings(tmp_path / "parts", 3), progress=interrupt)
    steps: list[int] = []
    fit_refiner(
        resumed, shifted, settings=settings(tmp_path / "parts", 3), progress=lambda _, step, __: steps.append(step)
    )
    assert steps == [3, 4, 5, 6]
    for name, value in whole.state_dict().items():
        assert torch.allclose(resumed.state_dict()[name], value, atol=1e-6), name


def test_what_is_learned_does_not_depend_on_the_number_of_processors(tmp_path: Path, shifted: Samples) -> None:
    one, three = network(), network()
    fit_refiner(one, shifted, settings=settings(tmp_path / "one", 2), progress=lambda *_: None)
    fit_refiner(three, shifted, settings=settings(tmp_path / "three", 2, workers=3), progress=lambda *_: None)
    for name, value in one.state_dict().items():
        assert torch.allclose(three.state_dict()[name], value, atol=1e-6), name


def test_a_damaged_checkpoint_is_named(tmp_path: Path, shifted: Samples) -> None:
    (tmp_path / "refiner.pt").write_bytes(b"nothing")
    with pytest.raises(TrainingError, match=r"refiner\.pt: not a checkpoint of a refiner \(.*\); remove it"):
        fit_refiner(network(), shifted, settings=settings(tmp_path, 1), progress=lambda *_: None)


def test_a_rare_class_is_drawn_more_often_than_it_comes() -> None:
    labels = np.repeat([0, 1, 2], [1600, 400, 100])
    drawn_labels = labels[drawn(labels, 7000, np.random.default_rng(1))]
    assert np.bincount(drawn_labels).tolist() == pytest.approx([4000, 2000, 1000], rel=0.1)


def test_the_rate_rises_and_falls_again() -> None:
    risen = round(1000 * WARM_UP)
    assert rate(0, 1000) == pytest.approx(RATE / risen, rel=0.01)
    assert rate(risen, 1000) == pytest.approx(RATE, rel=0.01)
    assert rate(999, 1000) == pytest.approx(LAST_RATE, rel=0.01)
    assert all(rate(step, 1000) > rate(step + 1, 1000) for step in range(risen, 999))
