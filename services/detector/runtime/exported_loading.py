"""Runs exported models under ONNX Runtime or OpenVINO, which need no torch."""

import logging
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.model import ModelError, first_line
from services.detector.runtime.choosing import RuntimeTarget, choose
from services.detector.runtime.engine import Engine, RunningModel, Runtime
from services.detector.runtime.exported_model import ExportedModel
from services.detector.runtime.model_file import ONNX_SUFFIX
from services.detector.runtime.pipeline import prove
from services.detector.runtime.refinement.refiner import Refiner, blank_close_ups
from services.detector.settings import DetectorSettings

log = logging.getLogger(__name__)

PACKAGES: Final[dict[Runtime, str]] = {"openvino": "openvino", "onnx": "onnxruntime"}
"""The package that each runtime needs, the faster one on most processors first."""

EXTRAS: Final[dict[Runtime, str]] = {"openvino": "openvino", "onnx": "detector-onnx"}


def running_export(
    model: ExportedModel, settings: DetectorSettings, folder: Path, blank: NDArray[np.uint8]
) -> RunningModel:
    """Return an exported model under the requested runtime, or the faster one of those installed.

    folder: for the choice if the cache cannot be written. blank: an empty image, see `prove`.

    Raises:
        ModelError: no runtime works here, or not the requested one.
    """
    gpu, threads = _gpu(settings.device), settings.inference_threads
    candidates = _candidates(model, settings.runtime, gpu)

    def make(runtime: Runtime) -> Engine:
        made = _made(runtime, model.file, threads, gpu)
        prove(made, blank, model.names, model.stride, model.head)
        return made

    if len(candidates) == 1:
        runtime = candidates[0]
        engine = make(runtime)
    else:
        place = RuntimeTarget(
            model.digest, model.longest, "cpu", threads, settings.cache, spare=folder, candidates=candidates
        )
        runtime, engine = choose(make, place, blank)
    refiner = None if model.refiner is None else _refiner(model.refiner, model, threads)
    return RunningModel(runtime, engine, None, refiner, many=gpu is not None and model.many)


def _candidates(model: ExportedModel, requested: str, gpu: int | None) -> tuple[Runtime, ...]:
    """Return the installed runtimes that can run a model, or the requested one alone."""
    able: tuple[Runtime, ...] = ("openvino", "onnx") if model.file.suffix.lower() == ONNX_SUFFIX else ("openvino",)
    if gpu is not None:
        able = tuple(each for each in able if each == "onnx")
    wanted = tuple(each for each in able if requested in ("auto", each))
    if not wanted:
        on = "" if gpu is None else " on a GPU"
        runs = f"runs under --runtime {' or '.join(able)}" if able else "cannot run"
        raise ModelError(f"--runtime {requested}: {model.path.name} is exported, and {runs}{on}")
    found = tuple(each for each in wanted if find_spec(PACKAGES[each]) is not None)
    if not found:
        missing = wanted[0]
        raise ModelError(
            f"--runtime {requested}: {PACKAGES[missing]} is not installed; see fleetsight's extra [{EXTRAS[missing]}]"
        )
    return found


def _gpu(device: str | None) -> int | None:
    """Return the number of the requested GPU; None for the processor, which is the default.

    Raises:
        ModelError: ONNX Runtime has none, or does not know the name.
    """
    name = (device or "cpu").strip().lower()
    if name == "cpu":
        return None
    number = name.removeprefix("cuda").removeprefix(":") or "0"
    if not number.isdecimal():
        raise ModelError(f"--device {device}: exported models run on cpu or cuda:0, cuda:1, ...")
    if find_spec("onnxruntime") is not None:
        from services.detector.runtime.onnx_engine import has_gpu  # noqa: PLC0415 - it may not be there

        if has_gpu():
            return int(number)
    raise ModelError(f"--device {device}: ONNX Runtime has no GPU here; install onnxruntime-gpu, or use weights")


def _made(runtime: Runtime, file: Path, threads: int, gpu: int | None) -> Engine:
    if runtime == "openvino":
        from services.detector.runtime.openvino_engine import OpenVinoEngine  # noqa: PLC0415 - it may not be there

        return OpenVinoEngine(file, threads)
    from services.detector.runtime.onnx_engine import OnnxEngine  # noqa: PLC0415 - as above

    return OnnxEngine(file, threads, gpu=gpu)


def _refiner(content: bytes, model: ExportedModel, threads: int) -> Refiner | None:
    """Return the refiner under ONNX Runtime; None, with a warning, where it does not work: masks then stay coarse."""
    try:
        from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner  # noqa: PLC0415 - as above

        refiner = OnnxRefiner(content, threads)
        refiner.run(blank_close_ups(1, refiner.prototypes))
    except Exception as error:  # noqa: BLE001 - what the model finds is no worse for it
        log.warning("%s leaves masks coarse: its refiner does not work: %s", model.path.name, first_line(error))
        return None
    return refiner
