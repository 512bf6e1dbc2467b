"""Makes one ONNX file of weights and their refiner, which runs without torch and says all that a worker must know."""

import base64
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from services.detector.model import ModelError
from services.detector.runtime.exported_model import (
    AGNOSTIC,
    HEAD,
    INT8,
    INT8_REFINER,
    REFINER,
    SOURCE,
    Int8Networks,
)
from services.detector.runtime.exporting import exported

if TYPE_CHECKING:
    from services.detector.runtime.weights import Weights

UNSTEADY: Final = ("date",)
"""Metadata that differs from one export of the same weights to the next."""

LEAST_HALVED: Final = 1024
"""Numbers of a tensor from which on it is kept in half precision: smaller ones take no room."""

Quantize = Callable[[bytes, bytes | None], Int8Networks]
"""Makes INT8 networks of a model's network and its refiner, each as the content of an ONNX file."""


def portable(weights: "Weights", longest: int, quantize: Quantize | None = None) -> bytes:
    """Return weights as the content of an ONNX file. longest: longer side of the input in pixels; others work too.

    The file keeps weights in half precision, as Ultralytics' checkpoints do; they are computed in single precision.
    quantize: for INT8 networks beside these, see `Quantizer`.

    Raises:
        ModelError: the export failed, or what it needs is not installed, or `quantize` raised it.
    """
    try:
        import onnx  # noqa: PLC0415 - it may not be there
    except ModuleNotFoundError as error:
        raise ModelError("onnx is not installed; see fleetsight's extra [onnx]") from error
    from services.detector.runtime.refinement.network import onnx_of  # noqa: PLC0415 - it needs torch

    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        made = exported(weights, "onnx", Path(folder), "cpu", longest, gpu="", spare=Path(folder) / "spare")
        model = onnx.load(made)
    refiner = None if weights.refiner is None else onnx.load_from_string(onnx_of(weights.refiner))
    parts: dict[str, bytes] = {}
    if quantize is not None:
        int8 = quantize(model.SerializeToString(), None if refiner is None else refiner.SerializeToString())
        made8 = {INT8: int8.network, INT8_REFINER: int8.refiner}
        parts |= {name: zlib.compress(each, 9) for name, each in made8.items() if each is not None}
    if refiner is not None:
        _halve(refiner)
        parts[REFINER] = refiner.SerializeToString(deterministic=True)
    entries = {each.key: each.value for each in model.metadata_props if each.key not in UNSTEADY}
    entries |= {HEAD: weights.head, SOURCE: weights.digest} | ({AGNOSTIC: str(True)} if weights.agnostic else {})
    entries |= {name: base64.b64encode(each).decode("ascii") for name, each in parts.items()}
    _halve(model)
    del model.graph.value_info[:]  # what runtimes work out by themselves
    del model.metadata_props[:]
    onnx.helper.set_model_props(model, dict(sorted(entries.items())))
    content: bytes = model.SerializeToString(deterministic=True)
    return content


def _halve(model: Any) -> None:
    """Keep the large tensors of an ONNX model in half precision; runtimes widen them once, as they load the model."""
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415 - as above

    widened = []
    for tensor in model.graph.initializer:
        if tensor.data_type != TensorProto.FLOAT:
            continue
        numbers, name = numpy_helper.to_array(tensor), tensor.name
        if numbers.size < LEAST_HALVED or np.abs(numbers).max() > np.finfo(np.float16).max:
            continue
        half = f"{name}.half"
        tensor.CopyFrom(numpy_helper.from_array(numbers.astype(np.float16), half))
        widened.append(helper.make_node("Cast", [half], [name], to=TensorProto.FLOAT))
    nodes = [*widened, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
