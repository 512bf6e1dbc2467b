"""A model under PyTorch, or an engine file under TensorRT, run on tensors by Ultralytics' AutoBackend."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from ultralytics.nn.autobackend import AutoBackend

from services.detector.runtime.engine import OutOfMemoryError, outputs
from services.detector.runtime.postprocess import Output

P = ParamSpec("P")
T = TypeVar("T")


def on_a_thread_that_ends(function: Callable[P, T]) -> Callable[P, T]:
    """Have a function that computes with torch run on a thread of its own, which ends with it.

    libgomp keeps helper threads for each thread that ever computed, until that one ends. Once they and their owners are
    more than the processors, all of them sleep at barriers where they spun before: a call of YOLO11n then switched
    threads 660 times and took 1.8 times as long, on two cores. So a model is called on one thread alone, and leaves no
    helpers on the one that loaded it.
    """

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        with ThreadPoolExecutor(1, "loading") as own:
            return own.submit(function, *args, **kwargs).result()

    return run


PROTOTYPES: Final = 4
"""Dimensions of a batch's prototypes: images, coefficients, height and width."""


class TorchEngine:
    """Runs a module or an engine file on a device."""

    def __init__(self, model: Any, device: torch.device) -> None:
        self._device = device
        self._backend = AutoBackend(model=model, device=device, fuse=True, verbose=False)
        self._backend.eval()
        self._format = _memory_format(self._backend)

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        try:
            with torch.inference_mode():
                batch = torch.from_numpy(images).to(self._device).permute(0, 3, 1, 2)
                found = self._backend(batch.to(memory_format=self._format).float().div_(255))
                predictions, prototypes = _parts(found)
                return outputs(_array(predictions), None if prototypes is None else _array(prototypes))
        except torch.OutOfMemoryError as error:
            torch.cuda.empty_cache()
            raise OutOfMemoryError(str(error)) from error


def _memory_format(backend: AutoBackend) -> torch.memory_format:
    """Return the memory format of a model's weights, in which its input need not be copied.

    On x86 Ultralytics has them with channels last, as pixels have them, too.
    """
    weights = backend.backend.model.parameters() if backend.format == "pt" else ()
    last = any(not each.is_contiguous() for each in weights)
    return torch.channels_last if last else torch.contiguous_format


def _parts(found: Any) -> tuple[torch.Tensor, torch.Tensor | None]:
    """Split a model's output into predictions, prototypes (segmentation models only) and inputs of the losses."""
    first = found[0] if isinstance(found, list | tuple) else found
    if isinstance(first, list | tuple):
        return first[0], first[1]
    second = found[1] if isinstance(found, list | tuple) and len(found) > 1 else None
    return first, second if isinstance(second, torch.Tensor) and second.ndim == PROTOTYPES else None


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return np.asarray(tensor.float().cpu().numpy(), np.float32)
