"""From a training checkpoint to the file that is shipped: half precision, and nothing in it about who made it where."""

import io
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from services.simulator.training.checkpoints import ARCHITECTURE, Checkpoint
from services.simulator.training.errors import TrainingError

_ABSOLUTE_PATH: Final = re.compile(rb"(?<![\w:/.-])(?:/[\w.+-]+){2,}|[A-Za-z]:\\[\w.+-]+")


def write_weights(checkpoint: Path, output: Path, imgsz: int, more: Mapping[str, Any] | None = None) -> None:
    """Strip `checkpoint`, which this command wrote, and put its averaged model at `output`, with `more` beside it.

    Raises TrainingError when a path of this machine would get into the file.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    arguments = {"task": "segment", "model": ARCHITECTURE, "imgsz": imgsz}
    model: Any = Checkpoint.read(checkpoint).network().half()
    model.requires_grad_(requires_grad=False)
    model.args, model.criterion, model.pt_path = dict(arguments), None, None
    model.yaml["yaml_file"] = ARCHITECTURE
    buffer = io.BytesIO()
    kept = {"epoch": -1, "model": model, "ema": None, "optimizer": None, "train_args": arguments, **(more or {})}
    torch.save(kept, buffer)
    content = buffer.getvalue()
    if found := embedded_paths(content):
        raise TrainingError(f"the weights would name paths of this machine: {', '.join(found)}")
    output.parent.mkdir(parents=True, exist_ok=True)
    partial = output.with_suffix(".part")
    partial.write_bytes(content)
    partial.replace(output)


def embedded_paths(content: bytes) -> list[str]:
    """The absolute paths in a torch file, but for the tensors' own bytes."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [archive.read(name) for name in archive.namelist() if "/data/" not in name]
    return sorted({match.decode() for member in members for match in _ABSOLUTE_PATH.findall(member)})
