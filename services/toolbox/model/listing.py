"""Lists published models, and the workers that run them."""

import asyncio
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Final

import msgspec

from bus import LATEST, Bus
from schemas import codec, keys, worker_keys
from schemas.errors import SchemaError
from schemas.models import SHORT_DIGEST, ModelRegistry, PublishedModel
from schemas.printing import printable
from schemas.status import WorkerStatus

LISTEN_S: Final = 1.5
"""How long workers are listened to: each sends its status once a second."""


async def worker_statuses(bus: Bus) -> list[WorkerStatus]:
    """Return the newest status of each detector worker that sends one now, by name."""
    found: dict[str, WorkerStatus] = {}
    key = worker_keys.every_worker_status(worker_keys.DETECTOR)
    with suppress(TimeoutError):
        async with asyncio.timeout(LISTEN_S), bus.subscribe(key, LATEST) as statuses:
            async for sample in statuses:
                with suppress(SchemaError):
                    status = codec.decode(WorkerStatus, sample.payload, sample.encoding)
                    found[status.worker] = status
    return [found[name] for name in sorted(found)]


async def absent_robots(bus: Bus, robots: Iterable[str]) -> list[str]:
    """Return those of `robots` whose gateways do not show themselves."""
    absent = set(robots)
    with suppress(TimeoutError):
        async with asyncio.timeout(LISTEN_S), bus.watch(keys.EVERY_ROBOT_ALIVE, few=True) as watch:
            while absent:
                presence = await anext(watch)
                if presence.alive:
                    with suppress(SchemaError):
                        absent.discard(keys.parse_robot(presence.key))
    return sorted(absent)


def as_json(state: ModelRegistry, statuses: Sequence[WorkerStatus]) -> str:
    """Return the registry's state and the workers as a line of JSON."""
    workers = [
        {
            "worker": each.worker,
            "model": each.model,
            "runtime": each.runtime,
            "canary": each.canary,
            "remarks": each.remarks,
        }
        for each in statuses
    ]
    return msgspec.json.encode({**msgspec.to_builtins(state), "workers": workers}).decode() + "\n"


def as_table(state: ModelRegistry, statuses: Sequence[WorkerStatus]) -> str:
    """Return a line for each model, newest first, and one for each worker."""
    models = [_model_row(state, each) for each in reversed(state.models)]
    lines = _columns([("model", "digest", "MB", "published", "by", "state"), *models])
    if not models:
        lines = ["no model is published yet: fleetsight model publish FILE"]
    workers = [
        (each.worker, each.model or "none yet", each.runtime, f"canary {each.canary}" if each.canary else "")
        for each in statuses
    ]
    lines += (
        ["", *_columns([("worker", "runs", "under", ""), *workers])] if workers else ["", "no detector worker is heard"]
    )
    for each in statuses:
        lines += [f"  {each.worker}: {remark}" for remark in each.remarks]
    return "".join(f"{printable(line)}\n" for line in lines)


def _model_row(state: ModelRegistry, model: PublishedModel) -> tuple[str, ...]:
    published = datetime.fromtimestamp(model.published_ns / 1e9, UTC)
    return (
        model.name,
        model.digest[:SHORT_DIGEST],
        f"{model.size / 1e6:.1f}",
        f"{published:%Y-%m-%d %H:%M} UTC",
        model.by,
        _state_of(state, model.digest),
    )


def _state_of(state: ModelRegistry, digest: str) -> str:
    if digest == state.in_force:
        return "in force"
    if digest == state.canary:
        return f"canary for {', '.join(state.robots)}"
    return "before" if digest == state.before else ""


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
