"""Exports models, once per content of the weights, and caches them."""

import errno
import hashlib
import logging
import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from services.detector.model import ModelError, first_line
from services.detector.runtime.engine import BATCH_ON_GPU
from services.detector.runtime.model_file import Head
from services.whole_file import FOLDER_MODE, NotOursError, check_ours, keep_others_out

if TYPE_CHECKING:
    from services.detector.runtime.weights import Weights

log = logging.getLogger(__name__)

MAKING: Final = ".exporting-"
ABANDONED_S: Final = 24 * 3600
"""Age at which a folder that was never put in place is that of a process that was killed: exports take minutes."""

DIGEST: Final = "digest"
"""The file beside an export that has its name in the cache and its SHA-256."""

FILES: Final = {"onnx": "model.onnx", "engine": "model.engine"}

BATCHES: Final = {"onnx": 1, "engine": BATCH_ON_GPU}
"""Images that each kind is made for: an engine takes no more of them at once, an ONNX file any number."""

EXPORTERS: Final[Mapping[str, tuple[str, ...]]] = {
    "onnx": ("ultralytics", "torch", "onnx"),
    "engine": ("ultralytics", "torch", "onnx", "tensorrt"),
}
"""Packages that make each kind; an engine is loaded only by the version that made it."""

UNWRITABLE: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES})
"""Error numbers of an exporter that cannot write where it should."""


def exported(
    weights: "Weights",
    kind: str,
    cache: Path,
    device: str,
    longest: int,
    *,
    gpu: str,
    spare: Path,
    damaged: Path | None = None,
) -> Path:
    """Return the model as a file for other runtimes, exported by Ultralytics unless it is in the cache.

    Any number of processes may do so at once: what is in the cache is whole, and the same whoever made it. Only what
    nobody but this user and root can have put there is returned, and only if it has the digest that it was kept under.

    kind: of FILES. device: to export on. gpu: what kind of GPU that is. spare: where it goes if the cache cannot be
    written, or read. damaged: a file that is of no use, wherever it is.

    Raises:
        ModelError: the export failed, the weights are no longer those that were loaded, or others can write the cache.
    """
    name = entry(weights.digest, kind, longest, installed(EXPORTERS[kind]), gpu, head=weights.head)
    for place in (cache, spare):
        file = place / name / FILES[kind]
        _check_ours(place, file)
        if file != damaged and os.access(file, os.R_OK):  # unlike Path's questions, answers where nobody may look
            if _is_as_kept(file):
                return file
            log.warning("%s: its SHA-256 is not the recorded one; exporting again", file)
            discard(file.parent)
    log.info("exporting %s for %s, once", weights.path.name, kind)
    export = partial(_export, weights, kind, device=device, longest=longest)
    try:
        return _kept(export, cache / name, spare / name) / FILES[kind]
    except ModelError:
        raise
    except Exception as error:
        raise ModelError(f"{weights.path.name} cannot be exported for {kind}: {first_line(error)}") from error


def _check_ours(cache: Path, file: Path) -> None:
    """Raise ModelError if others can write an export, or a folder that it is in; what is not there is nobody's."""
    try:
        check_ours(*(each for each in (cache, file.parent, file) if os.access(each, os.F_OK)))
    except NotOursError as error:
        raise ModelError(f"--cache {cache}: others could exchange its models: {error}") from error


def _is_as_kept(file: Path) -> bool:
    """Whether an export has the digest that was noted when it was put in the cache, under this name."""
    with suppress(OSError, UnicodeDecodeError):
        return (file.parent / DIGEST).read_text(encoding="ascii") == _note(file, file.parent.name)
    return False


def _note(file: Path, name: str) -> str:
    with file.open("rb") as content:
        return f"{hashlib.file_digest(content, 'sha256').hexdigest()} {name}\n"


def entry(digest: str, kind: str, longest: int, exporters: Sequence[str], gpu: str, *, head: Head = "nms") -> str:
    """Return an export's name in the cache. exporters: with versions. gpu: type that an engine is built for."""
    branch = ["nms-free"] if head == "nms-free" else []
    about = [longest, BATCHES[kind], *exporters, gpu if kind == "engine" else "", *branch]
    return f"{digest[:32]}-{hashlib.sha256(repr(about).encode()).hexdigest()[:32]}-{kind}"


def installed(packages: Iterable[str]) -> list[str]:
    """Return the names and versions of the installed packages behind these imports: `onnxruntime` has several."""
    names = packages_distributions()
    return sorted({f"{each} {version(each)}" for package in packages for each in names.get(package, ())})


def _kept(export: Callable[[Path], None], folder: Path, spare: Path) -> Path:
    """Export to a folder in the cache, or with a warning to `spare` if the cache cannot be written or read."""
    try:
        export(folder)
    except OSError as error:
        log.warning("--cache %s: %s: what is exported is not kept", folder.parent, error.strerror or error)
        export(spare)
        return spare
    return folder


def _export(weights: "Weights", kind: str, folder: Path, *, device: str, longest: int) -> None:
    folder.parent.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
    remove_abandoned(folder.parent, time.time())
    own = Path(tempfile.mkdtemp(prefix=MAKING, dir=folder.parent))
    making = own / folder.name
    try:
        making.mkdir()  # unlike `own`, which only we can enter, as open as the cache's other files
        copy = Path(shutil.copy(weights.path, making / "model.pt"))
        if hashlib.sha256(copy.read_bytes()).hexdigest() != weights.digest:  # it would be kept as what it is not
            raise ModelError(f"{weights.path.name} has been replaced since it was loaded: start again")
        made = _made(copy, weights, kind, device, longest)
        copy.unlink()
        if made != (making / FILES[kind]).absolute():
            raise RuntimeError(f"it is not where it should be: {made}")
        (making / DIGEST).write_text(_note(made, folder.name), encoding="ascii")
        put_in_place(making, folder)
        with (folder / FILES[kind]).open("rb"):
            pass  # another user may have been quicker, and keep it to themselves
    finally:
        shutil.rmtree(own, ignore_errors=True)


def _made(copy: Path, weights: "Weights", kind: str, device: str, longest: int) -> Path:
    """Make Ultralytics export a copy of the weights into its folder, with the branch of the head that is used.

    Raises:
        OSError: that cannot be written.
        Exception: anything else.
    """
    import torch  # noqa: PLC0415 - it is heavy, and is here by now
    from ultralytics.models import YOLO  # noqa: PLC0415 - the checkpoint's own module stays as it is

    from services.detector.runtime.checkpoint import exact_names  # noqa: PLC0415 - as above
    from services.detector.runtime.weights import keep_branch  # noqa: PLC0415 - it is heavy too

    threads = torch.get_num_threads()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with exact_names():
                model: Any = YOLO(copy.absolute())
            keep_branch(model.model, weights.head)
            model.model.names = dict(weights.names)
            options = {"dynamic": True, "batch": BATCHES[kind], "imgsz": longest, "device": device, "verbose": False}
            with _without_graphs():
                return Path(model.export(format=kind, **options))
    except OSError as error:
        if error.errno in UNWRITABLE:
            raise
        raise RuntimeError(first_line(error)) from error
    finally:
        torch.set_num_threads(threads)  # Ultralytics has set a number of its own


@contextmanager
def _without_graphs() -> Iterator[None]:
    """Keep torch from printing the graph of a model that it cannot export: thousands of lines.

    Its switch for that is turned on by every export, and nobody is asked.
    """
    import torch  # noqa: PLC0415 - as above

    switches = vars(torch._C)  # noqa: SLF001 - there are no others
    theirs = switches.get("_jit_set_onnx_log_enabled")
    if theirs is None:  # another torch may have no such switch, and then exports as well as it can
        yield
        return
    switches["_jit_set_onnx_log_enabled"] = lambda _: theirs(False)  # noqa: FBT003 - as torch calls it
    try:
        yield
    finally:
        switches["_jit_set_onnx_log_enabled"] = theirs


def discard(folder: Path) -> None:
    """Remove an export from the cache at once; processes that have it open keep it. Ignored if it cannot be removed."""
    with suppress(OSError), tempfile.TemporaryDirectory(prefix=MAKING, dir=folder.parent) as away:
        folder.rename(Path(away) / folder.name)


def remove_abandoned(cache: Path, now_s: float) -> None:
    """Remove leftovers of killed exports; folders that may still be in use stay."""
    for folder in cache.glob(f"{MAKING}*"):
        with suppress(FileNotFoundError):  # somebody else was quicker
            if now_s - folder.stat().st_mtime > ABANDONED_S:
                shutil.rmtree(folder, ignore_errors=True)


def put_in_place(made: Path, folder: Path) -> None:
    """Rename the export to `folder` atomically, unless another process was quicker."""
    for each in (*made.rglob("*"), made):  # folders too: they say which files there are
        keep_others_out(each)
        descriptor = os.open(each, os.O_RDONLY)
        try:
            os.fsync(descriptor)  # a machine may lose its power before what has its name already is written
        finally:
            os.close(descriptor)
    try:
        made.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
