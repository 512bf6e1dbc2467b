import io
from typing import Any

import numpy as np
import pytest
import torch

from services.detector.runtime.refinement.closeups import SIDE, CloseUps
from services.detector.runtime.refinement.torch_refiner import AT_ONCE, KEY, TorchRefiner, kept, network_in
from tests.services.detector.runtime.refinement.looks import CLASSES, looks, network


def saved(checkpoint: dict[str, Any]) -> dict[str, Any]:
    buffer = io.BytesIO()
    torch.save(checkpoint, buffer)
    buffer.seek(0)
    read: dict[str, Any] = torch.load(buffer, weights_only=True)
    return read


def test_however_many_there_are_each_is_refined_as_if_alone() -> None:
    refiner, many = TorchRefiner(network(), torch.device("cpu")), looks(AT_ONCE + 3)
    together = refiner.run(many)
    assert together.shape == (AT_ONCE + 3, SIDE, SIDE)
    for n in (0, AT_ONCE - 1, AT_ONCE, AT_ONCE + 2):
        one = CloseUps(
            many.pixels[n : n + 1], many.features[n : n + 1], many.labels[n : n + 1], many.windows[n : n + 1]
        )
        assert np.allclose(refiner.run(one)[0], together[n], atol=1e-4)


def test_none_are_refined_too() -> None:
    assert TorchRefiner(network(), torch.device("cpu")).run(looks(0)).shape == (0, SIDE, SIDE)


def test_a_network_is_found_again_in_the_checkpoint_that_keeps_it() -> None:
    made = network()
    found = network_in(saved({"model": None, **kept(made)}), CLASSES)
    assert found is not None
    for name, value in made.state_dict().items():
        assert torch.equal(found.state_dict()[name], value.half().to(value.dtype))


def test_most_checkpoints_have_none() -> None:
    assert network_in({"model": None}, CLASSES) is None


@pytest.mark.parametrize("broken", [{}, [], 3, {"of_features.0.weight": torch.ones(4)}])
def test_what_is_none_is_refused(broken: object) -> None:
    with pytest.raises(ValueError, match="mask_refiner is none for 3 classes"):
        network_in({KEY: broken}, CLASSES)


def test_one_for_other_classes_is_refused() -> None:
    with pytest.raises(ValueError, match="mask_refiner is none for 2 classes"):
        network_in(kept(network()), 2)
