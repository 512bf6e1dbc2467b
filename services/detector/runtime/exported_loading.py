"""Runs exported models under ONNX Runtime or OpenVINO, which need no torch."""

import logging
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.model import ModelError, first_line
from services.detector.runtime.choosing import INT8, RuntimeTarget, choose
from services.detector.runtime.engine import Engine, RunningModel, Runtime
from services.detector.runtime.exported_model import ExportedModel
from services.detector.runtime.model_file import ONNX_SUFFIX
from services.detector.runtime.pipeline import prove
from services.detector.runtime.postprocess import OutputError
from services.detector.runtime.refinement.refiner import Refiner, blank_close_ups
from services.detector.settings import GPU, ON_PROCESSORS, DetectorSettings

log = logging.getLogger(__name__)

PACKAGES: Final[dict[Runtime, str]] = {"openvino": "openvino", "openvino-int8": "openvino", "onnx": "onnxruntime"}
"""The package that each runtime needs; of runtimes that are as fast `choose` takes the first."""


def running_export(
    model: ExportedModel, settings: DetectorSettings, longest: int, folder: Path, blank: NDArray[np.uint8]
) -> RunningModel:
    """Return an exported model under the requested runtime, or the faster one of those installed.

    longest: longer side of the input in pixels. folder: for the choice if the cache cannot be written. blank: an empty
    image, see `prove`.

    Raises:
        ModelError: no runtime works here, or not the requested one.
    """
    under_openvino = settings.runtime in ON_PROCESSORS
    if under_openvino and (settings.device or "cpu").strip().lower() != "cpu":
        raise ModelError(
            f"--device {settings.device}: --runtime {settings.runtime} computes on the processor; leave --device out"
        )
    on_processor = under_openvino or model.file.suffix.lower() != ONNX_SUFFIX
    gpu = _gpu("cpu" if on_processor and settings.device is None else settings.device)
    threads = settings.inference_threads
    candidates = _candidates(model, settings, gpu)

    def make(runtime: Runtime) -> Engine:
        made = _made(runtime, model, threads, gpu)
        prove(made, blank, model.names, model.stride, head=model.head, task=model.task)
        return made

    if len(candidates) == 1:
        runtime = candidates[0]
        try:
            engine = make(runtime)
        except OutputError:
            raise
        except Exception as error:
            raise ModelError(
                f"{model.path.name} does not run under --runtime {runtime} here: {first_line(error)}"
            ) from error
    else:
        place = RuntimeTarget(
            model.digest, longest, "cpu", threads, settings.cache, spare=folder, candidates=candidates
        )
        runtime, engine = choose(make, place, blank)
    refiner = _refiner(model, runtime, engine, blank, threads)
    return RunningModel(runtime, engine, None, refiner, many=gpu is not None and model.many)


def _candidates(model: ExportedModel, settings: DetectorSettings, gpu: int | None) -> tuple[Runtime, ...]:
    """Return the installed runtimes that can run a model, or the requested one alone."""
    requested = settings.runtime
    if requested == INT8 and model.int8 is None:
        raise ModelError(
            f"--runtime {INT8}: {model.path.name} contains no INT8 networks: export its weights with --int8"
        )
    able: tuple[Runtime, ...] = tuple(PACKAGES)
    if model.file.suffix.lower() != ONNX_SUFFIX:
        able = ("openvino",)
    elif gpu is not None:
        able = ("onnx",)
    elif model.int8 is None or not (settings.int8 or requested == INT8):
        able = ("openvino", "onnx")
    wanted = tuple(each for each in able if requested in ("auto", each))
    if not wanted:
        on = "" if gpu is None else " on a GPU"
        runs = f"runs under --runtime {' or '.join(able)}" if able else "cannot run"
        raise ModelError(f"--runtime {requested}: {model.path.name} is exported, and {runs}{on}")
    found = tuple(each for each in wanted if find_spec(PACKAGES[each]) is not None)
    if not found:
        missing = PACKAGES[wanted[-1]]
        raise ModelError(f"--runtime {requested}: {missing} is not installed; pip install -c constraints.txt {missing}")
    return found


def _gpu(device: str | None) -> int | None:
    """Return the number of the GPU to use; None for the processor. By default the first, where there is one.

    Raises:
        ModelError: ONNX Runtime has none, or does not know the name.
    """
    able = _has_gpu()
    if device is None and not able and GPU.exists():
        log.warning("exported models run on the processor here, not on the GPU: ONNX Runtime cannot use it")
    name = (device or ("cuda" if able and GPU.exists() else "cpu")).strip().lower()
    if name == "cpu":
        return None
    number = name.removeprefix("cuda").removeprefix(":") or "0"
    if not number.isdecimal():
        raise ModelError(f"--device {device}: exported models run on cpu or cuda:0, cuda:1, ...")
    if able:
        return int(number)
    raise ModelError(
        f"--device {device}: ONNX Runtime has no GPU here; install onnxruntime-gpu in its place, or use weights"
    )


def _has_gpu() -> bool:
    if find_spec("onnxruntime") is None:
        return False
    from services.detector.runtime.onnx_engine import has_gpu  # noqa: PLC0415 - it may not be there

    return has_gpu()


def _made(runtime: Runtime, model: ExportedModel, threads: int, gpu: int | None) -> Engine:
    if runtime == "onnx":
        from services.detector.runtime.onnx_engine import OnnxEngine  # noqa: PLC0415 - it may not be there

        return OnnxEngine(model.file, threads, gpu=gpu)
    from services.detector.runtime.openvino_engine import OpenVinoEngine  # noqa: PLC0415 - as above

    return OpenVinoEngine(model.int8.network if runtime == INT8 and model.int8 else model.file, threads)


def _refiner(
    model: ExportedModel, runtime: Runtime, engine: Engine, blank: NDArray[np.uint8], threads: int
) -> Refiner | None:
    """Return the refiner, in INT8 beside such a network if it works; None, with a warning, where none does.

    Masks then stay coarse. In single precision it runs under ONNX Runtime; OpenVINO would take as long.
    """
    if model.refiner is None:
        return None
    (output,) = engine.run(blank)
    prototypes = 0 if output.prototypes is None else len(output.prototypes)
    int8 = model.int8.refiner if runtime == INT8 and model.int8 else None
    if int8 is not None:
        try:
            from services.detector.runtime.openvino_engine import OpenVinoRefiner  # noqa: PLC0415 - as above

            in_int8 = OpenVinoRefiner(int8, threads)
            in_int8.run(blank_close_ups(1, prototypes))
        except Exception as error:  # noqa: BLE001 - the other one may work
            log.warning("%s: masks are not refined in INT8: %s", model.path.name, first_line(error))
        else:
            return in_int8
    try:
        from services.detector.runtime.refinement.onnx_refiner import OnnxRefiner  # noqa: PLC0415 - as above

        refiner = OnnxRefiner(model.refiner, threads)
        refiner.run(blank_close_ups(1, prototypes))
    except Exception as error:  # noqa: BLE001 - what the model finds is no worse for it
        log.warning("%s leaves masks coarse: its refiner does not work: %s", model.path.name, first_line(error))
        return None
    return refiner
