from collections.abc import Callable

import numpy as np
import onnx
import pytest
import torch

from services.detector.runtime.openvino_engine import OpenVinoRefiner
from services.detector.runtime.refinement.network import onnx_of
from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner
from services.detector.runtime.refinement.refiner import AT_ONCE, SIDE, CloseUps, Refiner
from services.detector.runtime.refinement.torch_refiner import TorchRefiner
from tests.services.detector.runtime.refinement.looks import looks, network
from tests.services.detector.runtime.test_loading_refiner import computes_in_bfloat16

MAKERS: dict[str, Callable[[], Refiner]] = {
    "torch": lambda: TorchRefiner(network(), torch.device("cpu")),
    "onnx": lambda: OnnxRefiner(onnx_of(network()), 1),
    "openvino": lambda: OpenVinoRefiner(onnx_of(network()), 1),
    "onnx, of release 0.2": lambda: OnnxRefiner(taking_half_precision(onnx_of(network())), 1),
}


def taking_half_precision(content: bytes) -> bytes:
    """Have a network take features in half precision, as in exports of earlier releases."""
    model = onnx.load_from_string(content)
    (features,) = (each for each in model.graph.input if each.name == "features")
    features.name, features.type.tensor_type.elem_type = "half", onnx.TensorProto.FLOAT16
    model.graph.node.insert(0, onnx.helper.make_node("Cast", ["half"], ["features"], to=onnx.TensorProto.FLOAT))
    return bytes(model.SerializeToString())


@pytest.fixture(params=MAKERS)
def refiner(request: pytest.FixtureRequest) -> Refiner:
    """Return one under each library."""
    return MAKERS[request.param]()


def test_however_many_there_are_each_is_refined_as_torch_does_it_alone(refiner: Refiner) -> None:
    many, torch_refiner = looks(AT_ONCE + 3), MAKERS["torch"]()
    coarser = 10 if isinstance(refiner, OpenVinoRefiner) and computes_in_bfloat16() else 1
    together = refiner.run(many)
    assert together.odds.shape == (AT_ONCE + 3, SIDE, SIDE)
    for n in (0, AT_ONCE - 1, AT_ONCE, AT_ONCE + 2):
        part = slice(n, n + 1)
        one = CloseUps(many.pixels[part], many.features[part], many.labels[part], many.scores[part], many.windows[part])
        alone = torch_refiner.run(one)
        assert np.allclose(alone.odds[0], together.odds[n], atol=0.05 * coarser)
        assert alone.qualities[0] == pytest.approx(together.qualities[n], abs=0.01 * coarser)


@pytest.mark.parametrize("name", MAKERS)
def test_features_beyond_half_precision_do_no_harm(name: str) -> None:
    seen = looks(2)
    seen.features[0, 3, 3] = 1e6
    assert np.isfinite(MAKERS[name]().run(seen).odds).all()


def test_none_are_refined_too(refiner: Refiner) -> None:
    found = refiner.run(looks(0))
    assert found.odds.shape == (0, SIDE, SIDE)
    assert found.qualities.shape == (0,)


def test_how_sure_an_object_is_counts_for_the_quality_of_its_mask(refiner: Refiner) -> None:
    one = looks(1)
    same = CloseUps(
        np.repeat(one.pixels, 3, axis=0),
        np.repeat(one.features, 3, axis=0),
        np.repeat(one.labels, 3),
        np.array([0.0, 0.5, 1.0], np.float32),
        np.repeat(one.windows, 3, axis=0),
    )
    qualities = refiner.run(same).qualities
    assert np.all((qualities >= 0) & (qualities <= 1))
    assert len(set(qualities.tolist())) == 3
