import pytest
import torch

from services.detector.runtime.refinement.network import RefinerNetwork, expected_iou
from services.detector.runtime.refinement.refiner import CHANNELS, COARSE


@pytest.mark.parametrize("side", [8, 64])
def test_a_network_that_has_learned_nothing_says_what_the_coarse_mask_says(side: int) -> None:
    generator = torch.Generator().manual_seed(1)
    close_ups = torch.randint(0, 256, (3, side, side, CHANNELS), dtype=torch.uint8, generator=generator)
    features = torch.rand(3, side // 2, side // 2, 5, generator=generator)
    odds, qualities = RefinerNetwork(2, 5).eval()(close_ups, features, torch.tensor([0, 1, 0]), torch.ones(3))
    assert odds.shape == (3, side, side)
    assert qualities.shape == (3,)
    assert torch.equal(odds > 0, close_ups[..., COARSE] > 127)


def test_a_fused_network_says_the_same() -> None:
    torch.manual_seed(1)
    network = RefinerNetwork(2, 5)
    torch.nn.init.normal_(network.out.weight)
    close_ups = torch.randint(0, 256, (4, 64, 64, CHANNELS), dtype=torch.uint8)
    given = close_ups, torch.rand(4, 32, 32, 5), torch.tensor([0, 1, 0, 1]), torch.rand(4)
    with torch.no_grad():
        network(*given)  # learns what is normal
        before = network.eval()(*given)
        parameters = len(network.state_dict())
        network.fuse()
        for found, expected in zip(network(*given), before, strict=True):
            assert torch.allclose(found, expected, atol=1e-4)
    assert len(network.state_dict()) < parameters


def test_a_mask_is_expected_to_overlap_with_what_is_likely() -> None:
    odds = torch.full((3, 2, 2), -torch.inf)
    odds[1, 0] = torch.inf  # sure of half
    odds[2, 0] = torch.logit(torch.tensor(0.75))  # three quarters of a half, and of what else
    odds[2, 1, 0] = torch.logit(torch.tensor(0.25))
    assert expected_iou(odds).tolist() == pytest.approx([0, 1, 1.5 / 2.25])
