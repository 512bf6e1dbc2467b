import numpy as np
import pytest
import torch

from services.detector.runtime.refinement.closeups import SIDE
from services.detector.runtime.refinement.openvino_refiner import OpenVinoRefiner
from services.detector.runtime.refinement.torch_refiner import AT_ONCE, TorchRefiner
from tests.services.detector.runtime.refinement.looks import looks, network


@pytest.mark.parametrize("count", [0, 1, AT_ONCE + 3])
def test_it_finds_what_torch_finds(count: int) -> None:
    seen = looks(count)
    found = OpenVinoRefiner(network(), 1).run(seen)
    assert found.shape == (count, SIDE, SIDE)
    assert np.allclose(found, TorchRefiner(network(), torch.device("cpu")).run(seen), atol=0.05)
