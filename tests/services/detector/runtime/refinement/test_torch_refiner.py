import io
from typing import Any

import pytest
import torch

from services.detector.runtime.refinement.torch_refiner import KEY, kept, network_in
from tests.services.detector.runtime.refinement.looks import CLASSES, PROTOTYPES, network


def saved(checkpoint: dict[str, Any]) -> dict[str, Any]:
    buffer = io.BytesIO()
    torch.save(checkpoint, buffer)
    buffer.seek(0)
    read: dict[str, Any] = torch.load(buffer, weights_only=True)
    return read


def test_a_network_is_found_again_in_the_checkpoint_that_keeps_it() -> None:
    made = network()
    found = network_in(saved({"model": None, **kept(made)}), CLASSES, PROTOTYPES)
    assert found is not None
    for name, value in made.state_dict().items():
        assert torch.equal(found.state_dict()[name], value.half().to(value.dtype))


def test_most_checkpoints_have_none() -> None:
    assert network_in({"model": None}, CLASSES, PROTOTYPES) is None


@pytest.mark.parametrize("broken", [{}, [], 3, {"of_features.0.weight": torch.ones(4)}])
def test_what_is_none_is_refused(broken: object) -> None:
    with pytest.raises(ValueError, match="mask_refiner is none for 3 classes and 4 prototypes"):
        network_in({KEY: broken}, CLASSES, PROTOTYPES)


@pytest.mark.parametrize(("classes", "prototypes"), [(2, PROTOTYPES), (CLASSES, 5)])
def test_one_for_other_models_is_refused(classes: int, prototypes: int) -> None:
    with pytest.raises(ValueError, match=f"mask_refiner is none for {classes} classes and {prototypes} prototypes"):
        network_in(kept(network()), classes, prototypes)
