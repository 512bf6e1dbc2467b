"""A model's state as bytes, for a restart and for workers that stand by. Pure."""

from dataclasses import fields
from typing import Annotated, Any, Final

import msgspec
import numpy as np

from services.worldmodel.model import SiteModel
from services.worldmodel.objects import Objects
from services.worldmodel.offsets import RIGHT

VERSION: Final = 1
_LEFT_OUT: Final = frozenset({"anchor", "anchor_variance", "anchor_robot"})
"""Offsets are estimated anew, so what they were estimated from is not kept."""

SKIPPED: Final = 1 << 24
"""Numbers that a run may have given to objects since its state was saved, at most. Nobody may get them again."""

RUNS: Final = 1 << 16
"""Several runs may go on from one state, as where the first one ends before it saves its own: each skips another
multiple of SKIPPED, up to so many, so that they give different numbers. A number has 63 bits, room for 8 million
restarts."""


class StateError(Exception):
    """Bytes that are no state of a model, or of another version."""


class _Column(msgspec.Struct, frozen=True, array_like=True):
    kind: Annotated[str, msgspec.Meta(pattern=r"^<[fiu]\d$|^\|b1$")]
    data: bytes


class _State(msgspec.Struct, frozen=True, kw_only=True):
    version: int
    site: str
    prefix: str
    last: int
    next_number: int
    classes: list[str]
    cameras: list[tuple[str, str]]
    columns: dict[str, _Column]
    doubted: dict[str, int] = {}
    floors_m: list[float] = []
    named: dict[str, list[str]] = {}


def saved(site: str, prefix: str, last: int, model: SiteModel) -> bytes:
    """Return a model's confirmed objects, and which robots are doubted.

    prefix: of its ids. last: number of the last change that was told.
    """
    rows = model.objects.told_to_others()
    reasons = model.offsets.doubted
    columns = {}
    for each in fields(Objects):
        if each.name not in _LEFT_OUT:
            array = getattr(model.objects, each.name)[rows]
            columns[each.name] = _Column(array.dtype.str, np.ascontiguousarray(array).tobytes())
    return msgspec.msgpack.encode(
        _State(
            version=VERSION,
            site=site,
            prefix=prefix,
            last=last,
            next_number=model.lifecycle.next_number,
            classes=model.classes.names,
            cameras=model.cameras.names,
            columns=columns,
            doubted={name: why for name, number in model.robots.items() if (why := int(reasons[number])) != RIGHT},
            floors_m=model.offsets.floors.known.tolist(),
            named=model.vocabulary.known(),
        )
    )


def restored(site: str, data: bytes, model: SiteModel, run: int = 0) -> tuple[str, int]:
    """Fill a new model with what was saved of the site; return the prefix of its ids, and the last change's number.

    run: one of RUNS, by chance.

    Raises:
        StateError: they are no state of this site and version.
    """
    try:
        state = msgspec.msgpack.decode(data, type=_State)
        if state.version != VERSION or state.site != site:
            raise StateError(f"the state is of site {state.site!r} and version {state.version}")
        arrays = {name: np.frombuffer(column.data, column.kind) for name, column in state.columns.items()}
        objects = _objects(arrays)
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError) as error:
        raise StateError(f"not the state of a model: {error}") from error
    next_number = state.next_number + SKIPPED * (1 + run)
    model.restore(objects, state.classes, state.cameras, next_number)
    model.offsets.restore([model.robots.number(each) for each in state.doubted], list(state.doubted.values()))
    model.offsets.floors.restore(state.floors_m[: len(state.cameras)])
    model.vocabulary.restore(state.named, model.classes.names)
    return state.prefix, state.last


def _objects(arrays: dict[str, np.ndarray[Any, Any]]) -> Objects:
    count = len(arrays["number"])
    objects = Objects.none(max(count, 1))
    for each in fields(Objects):
        if each.name in arrays:
            column = getattr(objects, each.name)
            column[:count] = arrays[each.name].reshape(count, *column.shape[1:])
    return objects
