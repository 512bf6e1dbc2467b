import logging
import threading
from pathlib import Path
from typing import Any

import pytest
from pycocotools import mask as coco

from schemas.detections import Detection, Mask
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects, Request
from services.detector.runtime.loading import load
from services.detector.runtime.pipeline import Pipeline
from services.detector.runtime.refinement.refiner import CloseUps
from services.detector.settings import SHIPPED_MODEL
from tests.services.detector.runtime.test_loading import settings
from tests.services.detector.support.requests import frame_of
from tests.services.detector.support.views import near_view


def test_the_shipped_masks_are_refined_and_those_of_weights_without_a_refiner_are_not(
    tmp_path: Path, model_folder: Path
) -> None:
    import torch  # noqa: PLC0415 - as above

    refined = load(settings(model_folder), model_folder / "ultralytics")
    weights = torch.load(SHIPPED_MODEL, weights_only=False)
    torch.save({name: value for name, value in weights.items() if name != "mask_refiner"}, tmp_path / "coarse.pt")
    coarse = load(settings(model_folder, model=str(tmp_path / "coarse.pt")), model_folder / "ultralytics")
    unrefined = load(settings(model_folder, refine=False), model_folder / "ultralytics")
    fine, rough = objects_in(refined), objects_in(coarse)
    assert objects_in(unrefined) == rough
    assert [(each.name, each.score) for each in fine] == [(each.name, each.score) for each in rough]
    for one, other in zip(fine, rough, strict=True):
        assert one.mask != other.mask
        assert iou(one.mask, other.mask) > 0.3


def test_masks_are_refined_under_torch_where_onnx_is_not_installed(
    model_folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    monkeypatch.setattr("services.detector.runtime.torch_loading.not_installed", lambda _: ["onnx"])
    model = load(settings(model_folder, runtime="torch"), model_folder / "ultralytics")
    assert [line for line in caplog.messages if "masks" in line] == []
    assert all(each.mask is not None and each.mask.quality is not None for each in objects_in(model))


@pytest.mark.parametrize("runtime", ["torch", "onnx", "openvino"])
def test_masks_are_refined_under_onnx_on_a_processor_whatever_the_model_runs_under(
    model_folder: Path, runtime: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    model = load(settings(model_folder, runtime=runtime), model_folder / "ultralytics")
    assert [line for line in caplog.messages if "masks" in line] == ["masks are refined under onnx"]
    assert all(each.mask is not None and each.mask.quality is not None for each in objects_in(model))
    rounds = runtime == "openvino" and computes_in_bfloat16()
    assert [each for each in model.remarks if not (rounds and "differs from torch" in each)] == []


def test_a_refiner_that_does_not_work_under_a_runtime_works_under_torch(
    model_folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> bytes:
        raise RuntimeError("no such operator")

    monkeypatch.setattr("services.detector.runtime.torch_loading.onnx_of", fail)
    model = load(settings(model_folder, runtime="onnx"), model_folder / "ultralytics")
    assert caplog.messages == ["masks are refined under torch: onnx cannot: no such operator"]
    assert all(each.mask is not None and each.mask.quality is not None for each in objects_in(model))


def test_torch_leaves_no_helpers_on_threads_that_load_a_model(
    model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its threads sleep at every barrier as soon as two threads that live have computed."""
    import torch  # noqa: PLC0415 - as above

    computed: set[threading.Thread] = set()
    convolve = torch.nn.functional.conv2d

    def noted(*given: Any, **options: Any) -> Any:
        computed.add(threading.current_thread())
        return convolve(*given, **options)

    monkeypatch.setattr(torch.nn.functional, "conv2d", noted)
    monkeypatch.setattr("services.detector.runtime.torch_loading.not_installed", lambda _: ["onnx"])
    model = load(settings(model_folder, runtime="torch"), model_folder / "ultralytics")
    assert computed
    assert not any(each.is_alive() for each in computed)
    computed.clear()
    (outcome,) = model.run([Request(CameraKey("r1", "front"), frame_of(near_view()), masks=True)])
    assert isinstance(outcome, DetectedObjects)
    assert len(computed) == 1
    model.close()


def test_on_a_gpu_masks_are_refined_there(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch  # noqa: PLC0415 - as above

    from services.detector.runtime import torch_loading  # noqa: PLC0415 - as above
    from services.detector.runtime.refinement.network import RefinerNetwork  # noqa: PLC0415 - as above

    made: list[torch.device] = []

    class OnGpu:
        def __init__(self, _: RefinerNetwork, device: torch.device) -> None:
            made.append(device)

        def run(self, seen: CloseUps) -> None:
            assert len(seen.labels) == 1

    monkeypatch.setattr(torch_loading, "TorchRefiner", OnGpu)
    device, network = torch.device("cuda", 0), RefinerNetwork(prototypes=4, classes=1)
    assert isinstance(torch_loading._refiner(network, device, 1), OnGpu)
    assert made == [device]


def computes_in_bfloat16() -> bool:
    """Return whether OpenVINO does so on this processor."""
    import openvino  # noqa: PLC0415 - first the engine keeps its telemetry out

    return "BF16" in openvino.Core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")


def objects_in(model: Pipeline) -> list[Detection]:
    """Return what a model finds in a view that has something near in it."""
    (outcome,) = model.run([Request(CameraKey("r1", "front"), frame_of(near_view()), masks=True)])
    model.close()
    assert isinstance(outcome, DetectedObjects)
    assert outcome.objects
    return outcome.objects


def iou(one: Mask | None, other: Mask | None) -> float:
    """Return how well two masks lie on each other."""
    assert one is not None
    assert other is not None
    some, others = ([{"size": list(each.size), "counts": each.counts}] for each in (one, other))
    return float(coco.iou(some, others, [0])[0, 0])
