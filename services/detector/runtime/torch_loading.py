"""Runs weights under torch and, exported once, under the other runtimes. Needs torch."""

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from services.detector.model import ModelError, first_line
from services.detector.runtime.choosing import INT8, RuntimeTarget, check_installed, choose, for_weights
from services.detector.runtime.engine import BATCH_ON_GPU, Engine, RunningModel, Runtime
from services.detector.runtime.exporting import discard, exported
from services.detector.runtime.pipeline import prove
from services.detector.runtime.postprocess import OutputError
from services.detector.runtime.refinement.network import RefinerNetwork, onnx_of
from services.detector.runtime.refinement.refiner import Refiner, blank_close_ups
from services.detector.runtime.refinement.torch_refiner import TorchRefiner
from services.detector.runtime.torch_engine import TorchEngine, on_a_thread_that_ends
from services.detector.runtime.weights import Weights, device_of, keep_branch
from services.detector.settings import DetectorSettings, not_installed

log = logging.getLogger(__name__)

ONNX: Final = ("onnx", "onnxruntime")
"""Packages with which masks are refined under ONNX Runtime on a processor: it takes less time than torch."""


@on_a_thread_that_ends
def running_weights(
    weights: Weights,
    settings: DetectorSettings,
    longest: int,
    folder: Path,
    blank: NDArray[np.uint8],
    *,
    refine: bool = True,
) -> RunningModel:
    """Return weights under the requested runtime, or the fastest. Takes seconds.

    longest: longer side of the input in pixels. folder: for what is exported if the cache cannot be written. blank: an
    empty image, see `prove`. refine: with the refiner of the weights, if they have one.

    Raises:
        ModelError: no runtime works here, or not the requested one.
    """
    device = device_of(settings.device)
    place = _place(settings, weights, device, longest, folder)
    runtime, engine, reference = _engines(settings, weights, device, place, blank)
    refiner = None
    if refine and weights.refiner is not None:
        refiner = _refiner(weights.refiner, device, settings.inference_threads)
    return RunningModel(runtime, engine, None if runtime == "torch" else reference, refiner, many=device.type == "cuda")


def _place(
    settings: DetectorSettings, weights: Weights, device: torch.device, longest: int, folder: Path
) -> RuntimeTarget:
    return RuntimeTarget(
        weights.digest,
        longest,
        device.type,
        settings.inference_threads,
        settings.cache,
        spare=folder / "exported",
        gpu=torch.cuda.get_device_name(device) if device.type == "cuda" else "",
        candidates=for_weights(device.type),
    )


def _engines(
    settings: DetectorSettings, weights: Weights, device: torch.device, place: RuntimeTarget, blank: NDArray[np.uint8]
) -> tuple[Runtime, Engine, Engine]:
    """Return the runtime, the model under it, and the model under torch."""
    keep_branch(weights.model, weights.head)
    reference = TorchEngine(weights.model, device)
    torch.set_num_threads(place.threads)  # Ultralytics leaves it at cores - 1

    def make(runtime: Runtime) -> Engine:
        made = _make(runtime, weights=weights, device=device, place=place, reference=reference)
        prove(made, blank, weights.names, weights.stride, head=weights.head, task=weights.task)
        return made

    if settings.runtime == "auto":
        try:
            make("torch")  # what ails the weights is said at once, and of all runtimes
        except OutputError:
            raise
        except Exception as error:  # noqa: BLE001 - `choose` takes those that work
            log.debug("torch does not work here: %s", first_line(error))
        batch = np.repeat(blank, BATCH_ON_GPU, axis=0) if device.type == "cuda" else blank
        return *choose(make, place, batch), reference
    if settings.runtime == INT8:
        raise ModelError(
            f"--runtime {INT8}: weights contain no INT8 networks; exported models may:"
            f" fleetsight model export {weights.path.name} --int8 PICTURES"
        )
    check_installed(settings.runtime)
    return settings.runtime, make(settings.runtime), reference


def _refiner(network: RefinerNetwork, device: torch.device, threads: int) -> Refiner:
    """Return the refiner under ONNX Runtime on a processor where that works, else under torch. Run once: see `load`.

    Under OpenVINO it takes as long.
    """
    seen = blank_close_ups(1, network.prototypes)
    if device.type == "cpu" and not not_installed(ONNX):
        try:
            refiner = _onnx_refiner(network, threads)
            refiner.run(seen)
        except Exception as error:  # noqa: BLE001 - whatever ails one library, torch works
            log.warning("masks are refined under torch: onnx cannot: %s", first_line(error))
        else:
            log.info("masks are refined under onnx")
            return refiner
    slower = TorchRefiner(network, device)
    slower.run(seen)
    return slower


def _onnx_refiner(network: RefinerNetwork, threads: int) -> Refiner:
    from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner  # noqa: PLC0415 - it may not be there

    return OnnxRefiner(onnx_of(network), threads)


def _gpu(device: torch.device) -> int | None:
    """Return the number of a GPU that ONNX Runtime may use; its usual package knows processors alone."""
    from services.detector.runtime.onnx_engine import has_gpu  # noqa: PLC0415 - it may not be there

    return (device.index or 0) if device.type == "cuda" and has_gpu() else None


def _make(
    runtime: Runtime, *, weights: Weights, device: torch.device, place: RuntimeTarget, reference: Engine
) -> Engine:
    export = partial(exported, weights, cache=place.cache, device=str(device), longest=place.longest)
    file = partial(export, gpu=place.gpu, spare=place.spare)
    match runtime:
        case "torch":
            return reference
        case "onnx":
            from services.detector.runtime.onnx_engine import OnnxEngine  # noqa: PLC0415

            return _loaded(partial(OnnxEngine, threads=place.threads, gpu=_gpu(device)), partial(file, "onnx"))
        case "openvino":
            from services.detector.runtime.openvino_engine import OpenVinoEngine  # noqa: PLC0415

            return _loaded(partial(OpenVinoEngine, threads=place.threads), partial(file, "onnx"))
        case "tensorrt":
            return _loaded(partial(TorchEngine, device=device), partial(file, "engine"))
        case _:
            raise ValueError(runtime)


def _loaded(engine: Callable[[Path], Engine], file: Callable[..., Path]) -> Engine:
    """Return the exported model; one that cannot be loaded may be damaged, and is exported again."""
    path = file()
    try:
        return engine(path)
    except Exception as error:  # noqa: BLE001 - if the file is not to blame, it says so once more
        log.warning("%s cannot be loaded, and is exported again: %s", path, first_line(error))
        discard(path.parent)
        return engine(file(damaged=path))
