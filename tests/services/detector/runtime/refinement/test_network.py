import pytest
import torch

from services.detector.runtime.refinement.closeups import CHANNELS
from services.detector.runtime.refinement.network import COARSE, RefinerNetwork


@pytest.mark.parametrize("side", [8, 64])
def test_a_network_that_has_learned_nothing_says_what_the_coarse_mask_says(side: int) -> None:
    generator = torch.Generator().manual_seed(1)
    close_ups = torch.randint(0, 256, (3, side, side, CHANNELS), dtype=torch.uint8, generator=generator)
    features = torch.rand(3, side // 2, side // 2, 5, generator=generator)
    odds = RefinerNetwork(2, 5).eval()(close_ups, features, torch.tensor([0, 1, 0]))
    assert odds.shape == (3, side, side)
    assert torch.equal(odds > 0, close_ups[..., COARSE] > 127)


def test_a_fused_network_says_the_same() -> None:
    torch.manual_seed(1)
    network = RefinerNetwork(2, 5)
    torch.nn.init.normal_(network.out.weight)
    close_ups = torch.randint(0, 256, (4, 64, 64, CHANNELS), dtype=torch.uint8)
    features, labels = torch.rand(4, 32, 32, 5), torch.tensor([0, 1, 0, 1])
    with torch.no_grad():
        network(close_ups, features, labels)  # learns what is normal
        before = network.eval()(close_ups, features, labels)
        parameters = len(network.state_dict())
        network.fuse()
        assert torch.allclose(network(close_ups, features, labels), before, atol=1e-4)
    assert len(network.state_dict()) < parameters
