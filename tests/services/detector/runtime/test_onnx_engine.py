import subprocess
import sys

import pytest

from services.detector.runtime.onnx_engine import is_out_of_memory, providers


@pytest.mark.parametrize(
    "text",
    [
        "Non-zero status code returned while running Conv node. Failed to allocate memory for requested buffer",
        "CUDA failure 2: out of memory ; GPU=0",
        "CUDNN failure 2: CUDNN_STATUS_ALLOC_FAILED ; GPU=0",
    ],
)
def test_what_says_that_the_gpu_has_too_little_memory(text: str) -> None:
    assert is_out_of_memory(RuntimeError(text))


def test_other_errors_say_nothing_of_memory() -> None:
    assert not is_out_of_memory(RuntimeError("Got invalid dimensions for input: images"))


def test_the_gpu_that_was_asked_for_computes_where_onnx_runtime_can_use_it() -> None:
    cpu, cuda = "CPUExecutionProvider", "CUDAExecutionProvider"
    assert providers(1, [cuda, cpu]) == [(cuda, {"device_id": "1"}), cpu]
    assert providers(1, [cpu]) == providers(None, [cuda, cpu]) == [cpu]


IDLE = """
import time
import numpy as np
from services.detector.runtime.onnx_engine import OnnxEngine
from services.detector.settings import SHIPPED_EXPORT

engine = OnnxEngine(SHIPPED_EXPORT, 2, gpu=None)
engine.run(np.zeros((1, 96, 96, 3), np.uint8))
began_s = time.process_time()
time.sleep(1)
print(time.process_time() - began_s)
"""


def test_threads_spin_for_no_longer_than_a_call() -> None:
    told = subprocess.run([sys.executable, "-c", IDLE], capture_output=True, text=True, check=True)
    assert float(told.stdout) < 0.5
