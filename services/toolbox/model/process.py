"""Talks to the model registry, and prints what came of it."""

import asyncio
import getpass
import socket
import sys
import tempfile
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from bus import Bus, NotServedError, RefusedError, RequestError, RequestTimeoutError, open_bus
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.models import MAX_MODEL_BYTES, SHORT_DIGEST, ModelRegistry, ModelUse, PublishedModel
from schemas.printing import printable
from services.detector.settings import WEIGHTS_NEED, DetectorSettings, not_installed
from services.model_registry.client import ask_registry, publish_model, use_model
from services.model_registry.registry import digest_of
from services.toolbox.model.listing import absent_robots, as_json, as_table, worker_statuses
from services.toolbox.model.settings import ModelSettings
from services.whole_file import write_whole

if TYPE_CHECKING:
    from services.detector.runtime.model_file import ModelFile

FAILED: Final = 1
EXPORTERS: Final = (*WEIGHTS_NEED, "onnx")
"""Packages that an export needs."""

MIN_PREFIX: Final = 4
"""Letters of a digest that stand for it at least."""

NO_REGISTRY: Final = (
    "no model registry answers: start the fleet's monitor with --models FOLDER; where there are access rules, only"
    " an operator's certificate may ask"
)


class _ModelCommandError(Exception):
    """It cannot be done; the message is one line for the user."""


async def run(settings: ModelSettings) -> int:
    """Run the task; print what was done, or on stderr why not. Returns the exit code."""
    try:
        await _TASKS[settings.task](settings)
    except NotServedError as error:
        return _fail(str(error) if "router" in str(error) else NO_REGISTRY)
    except (RequestError, SchemaError, _ModelCommandError) as error:
        return _fail(str(error))
    except OSError as error:
        return _fail(f"{error.filename or settings.target}: {error.strerror}")
    return 0


def _fail(reason: str) -> int:
    sys.stderr.write(f"fleetsight model: {printable(' '.join(reason.split()))}\n")
    return FAILED


def _warn(remark: str) -> None:
    sys.stderr.write(f"fleetsight model: {printable(remark)}\n")


def _print(line: str) -> None:
    sys.stdout.write(f"{printable(line)}\n")


async def _publish(settings: ModelSettings) -> None:
    file = settings.file
    model = await asyncio.to_thread(_described, file, settings.published_name)
    async with open_bus(settings) as bus:
        known = await ask_registry(bus, settings.timeout_s)
        if (same := known.find(model.digest)) is not None:
            _print(f"published already: {same.label}, by {same.by}")
            return
        await publish_model(bus, model, file, _Progress(model))
    _print(f"published: {model.label}, {model.about}")
    _print(f"put it in force with: fleetsight model use {model.name}")


def _described(file: Path, name: str) -> PublishedModel:
    """Return all that is published about a file but its time. Loads it: takes seconds.

    Raises:
        _ModelCommandError: it is no model that detectors could use.
        OSError: it cannot be read.
    """
    size = file.stat().st_size
    if size > MAX_MODEL_BYTES:
        raise _ModelCommandError(f"{file} has {size} bytes: the registry takes files of {MAX_MODEL_BYTES} at most")
    from services.detector.runtime.model_file import is_exported  # noqa: PLC0415 - publishing needs the extra

    weights = _read(file, "publish")
    form: Literal["onnx", "pt"] = "onnx" if is_exported(str(file)) else "pt"
    if form == "onnx":
        _try(file, "onnx")
        if weights.has_int8 and not not_installed(["openvino"]):
            _try(file, "openvino-int8")
    names = list(dict.fromkeys(weights.names.values()))
    about = f"{weights.task.title} of {', '.join(names)}"[:MAX_LABEL]
    return PublishedModel(digest=digest_of(file), name=name, size=size, by=_myself(), about=about, form=form)


@contextmanager
def _own_errors() -> Iterator[Path]:
    """Give a folder for as long as the context lasts; a ModelError there becomes this command's."""
    from services.detector.model import ModelError  # noqa: PLC0415 - some tasks alone need the extra

    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        try:
            yield Path(folder)
        except ModelError as error:
            raise _ModelCommandError(str(error)) from error


def _read(file: Path, option: str) -> "ModelFile":
    """Read a model's file; option: how to call it in messages. Takes seconds.

    Raises:
        _ModelCommandError: it is no model that detectors could use.
    """
    from services.detector.runtime.loading import read_model  # noqa: PLC0415 - as above

    with _own_errors() as folder:
        return read_model(str(file), folder, option)


def _try(file: Path, runtime: str) -> None:
    """Run an exported model once: unlike weights, it is a program, which may never end. Raises as `_read` does."""
    from services.detector.runtime.loading import load  # noqa: PLC0415 - as above

    with _own_errors() as folder:
        chosen = {"model": str(file), "runtime": runtime, "device": "cpu", "cache": folder}
        load(DetectorSettings.model_validate(chosen), folder).close()


async def _export(settings: ModelSettings) -> None:
    content, remark = await asyncio.to_thread(_exported, settings)
    await asyncio.to_thread(write_whole, settings.exported_file, content)
    _print(f"exported: {settings.exported_file}, {len(content) / 1e6:.1f} MB; it runs without torch{remark}")


def _exported(settings: ModelSettings) -> tuple[bytes, str]:
    """Return the file's content, and what is to be said of it."""
    if missing := not_installed([*EXPORTERS, *(["onnxruntime"] if settings.int8 else [])]):
        raise _ModelCommandError(
            f"export: {missing[0]} is not installed; it comes with pip install -c constraints.txt '.[onnx]'"
        )
    with _own_errors() as folder:  # Ultralytics keeps its settings there for as long as it exports
        from services.detector.runtime.loading import read_model  # noqa: PLC0415 - as above
        from services.detector.runtime.portable import portable  # noqa: PLC0415 - as above

        weights = read_model(str(settings.file), folder, "export", nms=settings.nms)
        from services.detector.runtime.weights import Weights  # noqa: PLC0415 - it needs what reading has set

        if not isinstance(weights, Weights):
            raise _ModelCommandError(f"{settings.target} is exported already")
        longest = settings.image_size or weights.longest
        if settings.int8 is None:
            return portable(weights, longest), ""
        from services.detector.runtime.quantizing import Quantizer  # noqa: PLC0415 - as above

        quantizer = Quantizer(weights, longest, settings.pictures, _show)
        content = portable(weights, longest, quantizer)
        return content, f"; in INT8 {quantizer.equal} of {quantizer.compared} pictures get the same classes"


def _myself() -> str:
    user = "somebody"
    with suppress(OSError, KeyError):  # a user id without a name
        user = getpass.getuser()
    return f"{user}@{socket.gethostname()}"[:MAX_LABEL]


def _show(step: str, done: int, total: int) -> None:
    """Show on a terminal how many pictures were looked at."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{step}: {done} of {total} pictures" + ("\n" if done == total else ""))
        sys.stderr.flush()


class _Progress:
    """Shows on a terminal how much of a file was sent."""

    def __init__(self, model: PublishedModel) -> None:
        self._model = model

    def __call__(self, there: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if there >= self._model.size else ""
            line = f"\r{self._model.name}: {there / 1e6:.1f} of {self._model.size / 1e6:.1f} MB{end}"
            sys.stderr.write(line)
            sys.stderr.flush()


async def _use(settings: ModelSettings) -> None:
    async with open_bus(settings) as bus:
        model = chosen(await ask_registry(bus, settings.timeout_s), settings.target)
        asked = ModelUse(digest=model.digest, robots=settings.robots)
        _tell(await _changed(bus, asked, settings.timeout_s))
        if settings.robots and (absent := await absent_robots(bus, settings.robots)):
            _warn(f"not online now, so check the names: {', '.join(absent)}")


async def _back(settings: ModelSettings) -> None:
    async with open_bus(settings) as bus:
        state = await ask_registry(bus, settings.timeout_s)
        asked = ModelUse(digest="", leaving=state.canary or state.in_force)
        _tell(await _changed(bus, asked, settings.timeout_s))


async def _changed(bus: Bus, asked: ModelUse, timeout_s: float) -> ModelRegistry:
    try:
        return await use_model(bus, asked, timeout_s)
    except RefusedError as error:
        raise _ModelCommandError(str(error)) from error
    except (RequestTimeoutError, NotServedError) as error:
        raise _ModelCommandError(f"{error}; it may have been done: fleetsight model list") from error


def _tell(state: ModelRegistry) -> None:
    in_force, canary = state.find(state.in_force), state.find(state.canary)
    _print("in force: " + ("no model" if in_force is None else in_force.label))
    if canary is not None:
        _print(f"canary for {', '.join(state.robots)}: {canary.label}")
    _print("which workers run it by now: fleetsight model list")


def chosen(state: ModelRegistry, target: str) -> PublishedModel:
    """Return the model of this name, or whose digest begins so; also of a label, name@digest.

    Raises:
        _ModelCommandError: there is none, or there are several.
    """
    name, _, letters = target.removesuffix(".pt").removesuffix(".onnx").partition("@")
    found = [each for each in state.models if each.name == name and each.digest.startswith(letters)] if letters else []
    prefix = target.lower()
    found = found or [
        each
        for each in state.models
        if each.name == target or (len(prefix) >= MIN_PREFIX and each.digest.startswith(prefix))
    ]
    if len(found) > 1:
        several = ", ".join(f"{each.name}@{each.digest[: max(SHORT_DIGEST, len(prefix) + 1)]}" for each in found)
        raise _ModelCommandError(f"{target[:80]} is ambiguous: {several}; write one of these, or more letters")
    if not found:
        known = ", ".join(each.name for each in state.models) or "none is published yet"
        raise _ModelCommandError(f"no published model is called {target[:80]!r}; there are: {known}")
    return found[0]


async def _list(settings: ModelSettings) -> None:
    async with open_bus(settings) as bus:
        state = await ask_registry(bus, settings.timeout_s)
        statuses = await worker_statuses(bus)
    sys.stdout.write(as_json(state, statuses) if settings.json_ else as_table(state, statuses))


_TASKS: Final[Mapping[str, Callable[[ModelSettings], Awaitable[None]]]] = {
    "export": _export,
    "publish": _publish,
    "list": _list,
    "use": _use,
    "back": _back,
}
