"""A model under ONNX Runtime."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from services.detector.model import first_line
from services.detector.runtime.engine import OutOfMemoryError, outputs
from services.detector.runtime.postprocess import Output

_CPU: Final = "CPUExecutionProvider"
_CUDA: Final = "CUDAExecutionProvider"
ERRORS_ONLY: Final = 3
HALF: Final = "tensor(float16)"
"""The type of the input of a model that was exported in half precision."""

Provider = str | tuple[str, dict[str, str]]
NO_MEMORY: Final = (
    "failed to allocate memory",
    "out of memory",
    "cudnn_status_alloc_failed",
    "cublas_status_alloc_failed",
)
"""Texts in errors of its arena, CUDA, cuDNN and cuBLAS, in small letters."""


def session_options(threads: int) -> onnxruntime.SessionOptions:
    """Return session options for this many threads, which spin while one call lasts, and not while idle.

    Without spinning a call switched threads 240 times, and took a tenth to a fifth more on two cores.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = ERRORS_ONLY
    options.add_session_config_entry("session.force_spinning_stop", "1")
    options.add_session_config_entry("session.dynamic_block_base", "4")  # a thread that was interrupted does less
    return options


def alone(options: onnxruntime.SessionOptions) -> onnxruntime.SessionOptions:
    """Have a session look for no weights in files beside a model's: nothing else of it is published or kept."""
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    return options


def is_out_of_memory(error: Exception) -> bool:
    """Return whether an error of ONNX Runtime means that the GPU ran out of memory; there is no type for it."""
    return any(sign in str(error).lower() for sign in NO_MEMORY)


def providers(gpu: int | None, able: Sequence[str]) -> list[Provider]:
    """Return the execution providers to use, of those that are installed. gpu: its number, None for none."""
    if gpu is None or _CUDA not in able:
        return [_CPU]
    return [(_CUDA, {"device_id": str(gpu)}), _CPU]


def has_gpu() -> bool:
    """Whether the installed ONNX Runtime can use NVIDIA's GPUs."""
    return _CUDA in onnxruntime.get_available_providers()


class OnnxEngine:
    """Runs an ONNX file or its content on the CPU, or a GPU where the installed ONNX Runtime can; see `providers`."""

    def __init__(self, model: Path | bytes, threads: int, *, gpu: int | None) -> None:
        able = onnxruntime.get_available_providers()
        content = model if isinstance(model, bytes) else model.read_bytes()  # of a path it takes texts alone
        options = alone(session_options(threads))
        self._session = onnxruntime.InferenceSession(content, options, providers=providers(gpu, able))
        if gpu is not None and _CUDA not in self._session.get_providers():
            raise RuntimeError(f"ONNX Runtime cannot use GPU {gpu}")
        first = self._session.get_inputs()[0]
        self._input = first.name
        self._half = first.type == HALF

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        batch = images.transpose(0, 3, 1, 2).astype(np.float32, order="C")
        batch /= 255
        given = batch.astype(np.float16) if self._half else batch
        try:
            predictions, *prototypes = self._session.run(None, {self._input: given})
        except Exception as error:
            if is_out_of_memory(error):
                raise OutOfMemoryError(first_line(error)) from error
            raise
        predictions, *prototypes = (np.asarray(each, np.float32) for each in (predictions, *prototypes))
        return outputs(predictions, prototypes[0] if prototypes else None)
