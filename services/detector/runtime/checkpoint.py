"""Reads the content of an Ultralytics checkpoint, from exactly the named file, as data only."""

import re
import threading
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Final

import numpy as np
import torch
from ultralytics.nn.tasks import load_checkpoint, torch_safe_load
from ultralytics.utils import downloads

from schemas.printing import printable
from services.detector.model import first_line

NUMBERS: Final = ("?", "b", "B", "h", "H", "i", "I", "l", "L", "q", "Q", "e", "f", "d", "U1")
"""NumPy's codes for numbers and texts, which a checkpoint may hold: as data they execute nothing."""

YOLOV5: Final = frozenset({"models", "models.yolo", "models.common", "models.experimental"})
"""Modules of https://github.com/ultralytics/yolov5, whose checkpoints name them."""

NOT_FOR_THIS: Final = (
    "it appears to be an Ultralytics YOLOv5 model originally trained with https://github.com/ultralytics/yolov5, which"
    " is not forwards compatible with the package ultralytics: train a new model with that package, or take a"
    " published one, such as yolov5su.pt"
)
NO_PICKLE: Final = "damaged, or not written by torch"
"""Said where the error names only a number out of the file, or what Ultralytics makes of that."""

DOWNLOADS: Final = threading.RLock()
"""Held by whoever has Ultralytics look for a file, for `exact_names` changes how it does so in the whole process."""

MOST_BYTES: Final = 4 << 30
"""Of a file as it is unpacked. The largest published models have some 150 MB."""

ULTRALYTICS_ERROR_PREFIX: Final = "ERROR \u274c\ufe0f "
MAX_NAMED: Final = 3
"""Types or entries that a refusal names at most."""


class CheckpointError(Exception):
    """The file is not a checkpoint of a model; the message says why, in one line."""


def read_checkpoint(file: Path) -> tuple[Any, dict[str, Any]]:
    """Return a file's model, in evaluation mode and single precision, and the whole content of the file.

    Raises:
        CheckpointError: it is none, or holds what is not data.
    """
    torch.serialization.add_safe_globals([type(np.dtype(code)) for code in NUMBERS])
    path = file.absolute()  # what begins with a scheme would be an address
    _check_size(path)
    try:
        with warnings.catch_warnings(), exact_names():
            warnings.simplefilter("ignore")  # what is wrong is said in one line
            _check_tensors(torch_safe_load(path)[0])
            model, content = load_checkpoint(path)
    except Exception as error:
        raise CheckpointError(_reason(path, error)) from error
    return model, content


def _check_size(path: Path) -> None:
    """Raise CheckpointError for a file that would fill the memory: torch's archives are never compressed."""
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                size = sum(each.file_size for each in archive.infolist())
        else:
            size = path.stat().st_size
    except Exception:  # noqa: BLE001 - whoever reads it says what is wrong
        return
    if size > MOST_BYTES:
        raise CheckpointError(f"it has {size} bytes unpacked, at most {MOST_BYTES} are loaded")


def _check_tensors(content: Mapping[str, Any]) -> None:
    """Raise CheckpointError for tensors that repeat few numbers: in single precision each would take memory."""
    for model in (content.get("ema"), content.get("model")):
        for tensor in (*model.parameters(), *model.buffers()) if isinstance(model, torch.nn.Module) else ():
            size = tensor.numel() * tensor.element_size()
            if size > (stored := tensor.untyped_storage().nbytes()):
                raise CheckpointError(f"it has a tensor of {size} bytes of which {stored} are in the file")


@contextmanager
def exact_names() -> Iterator[None]:
    """Make Ultralytics read exactly the given files, by absolute paths.

    Otherwise apostrophes vanish from a name, yolov5s.pt becomes yolov5su.pt, and GitHub is asked for what is then not
    there, YOLO_OFFLINE or not.
    """
    with DOWNLOADS:
        theirs = vars(downloads)["attempt_download_asset"]
        vars(downloads)["attempt_download_asset"] = str
        try:
            yield
        finally:
            vars(downloads)["attempt_download_asset"] = theirs


def _reason(path: Path, error: Exception) -> str:
    if isinstance(error, CheckpointError):
        return str(error)
    foreign = _foreign_types(path, error)
    if any(name.rpartition(".")[0] in YOLOV5 for name in foreign):
        return NOT_FOR_THIS
    if called := re.search(r"unsafe (getattr\(.+?\)) blocked", f"{error.__cause__}"):
        foreign = [called[1]]
    if foreign:
        return (
            f"it holds {_listed(foreign)}, which would be executed: save it again without, with numbers, texts and"
            " tensors alone"
        )
    if isinstance(error, LookupError) or isinstance(error.__cause__, UnpicklingError):
        return NO_PICKLE
    if (entries := _entries_without_model(path)) is not None:
        held = f"only {_listed(entries)}" if entries else "it is empty"
        return f"it holds no model, {held}: save the whole checkpoint, as Ultralytics' model.save() does"
    return first_line(error).removeprefix(ULTRALYTICS_ERROR_PREFIX).replace(str(path), "it")


def _listed(names: list[str]) -> str:
    return ", ".join([*names[:MAX_NAMED], *(["..."] if len(names) > MAX_NAMED else [])])


def _entries_without_model(path: Path) -> list[str] | None:
    """Return what a file of torch's holds, with the types, if a model is not among it; else None."""
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:  # noqa: BLE001 - as reading it failed before: it is not what is missing
        return None
    if not isinstance(content, Mapping):
        return None if isinstance(content, torch.nn.Module) else [f"a {type(content).__name__}"]
    if isinstance(content.get("ema") or content.get("model"), torch.nn.Module):
        return None
    return [f"{printable(str(name))} ({type(value).__name__})" for name, value in content.items()]


def _foreign_types(path: Path, error: Exception) -> list[str]:
    """Return the names of the types in a file that do not belong in a checkpoint. error: raised by reading it."""
    try:
        return sorted(torch.serialization.get_unsafe_globals_in_checkpoint(path))
    except Exception:  # noqa: BLE001 - in no archive of torch's, as before its version 1.6, only the error names one
        return re.findall(r"Unsupported global: GLOBAL (\S+)", f"{error.__cause__}")[:1]
