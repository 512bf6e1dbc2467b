"""Our tree of transforms beside tf2's own buffer: both are told the same, and asked the same."""

import asyncio
import json
import math
from typing import Any, Final

import numpy as np
import pytest

from schemas.transforms import Transform
from services.geometry.errors import TransformError
from services.geometry.rotation import matrix_of
from services.geometry.transforms import Numbers, TransformTree
from tests.integration.peers.ros import PEERS, SYSTEM_PYTHON, require_ros

SCRIPT: Final = PEERS / "tf2_lookups.py"
S: Final = 1_000_000_000
MS: Final = 1_000_000

Said = tuple[bool, Transform]
Asked = tuple[str, str, int]


def said(parent: str, child: str, x: float, yaw: float, at: int, *, static: bool = False) -> Said:
    rotation = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return static, Transform(
        frame_id=parent, child_frame_id=child, stamp_ns=at, translation=(x, x / 2, 0.1), rotation=rotation
    )


async def by_tf2(told: list[Said], asked: list[Asked]) -> list[Numbers | None]:
    each = [[static, of.frame_id, of.child_frame_id, of.translation, of.rotation, of.stamp_ns] for static, of in told]
    process = await asyncio.create_subprocess_exec(
        *(SYSTEM_PYTHON, str(SCRIPT), json.dumps({"said": each, "asked": asked})), stdout=asyncio.subprocess.PIPE
    )
    out, _ = await process.communicate()
    answers: list[Any] = json.loads(out)
    return [matrix_of(*map(np.array, answer)) if answer else None for answer in answers]


def by_us(told: list[Said], asked: list[Asked]) -> list[Numbers | None]:
    tree = TransformTree()
    for static, transform in told:
        tree.add(transform, static=static)
    found: list[Numbers | None] = []
    for question in asked:
        try:
            found.append(tree.lookup(*question))
        except TransformError:
            found.append(None)
    return found


async def assert_same(told: list[Said], asked: list[Asked]) -> None:
    theirs, ours = await by_tf2(told, asked), by_us(told, asked)
    assert [answer is None for answer in ours] == [answer is None for answer in theirs]
    for our, their in zip(ours, theirs, strict=True):
        if our is not None and their is not None:
            assert our == pytest.approx(their, abs=1e-6)


async def test_static_transforms_said_again_change_no_frame_that_moves() -> None:
    """A broadcaster of static transforms says all of them again with each new one, as the gateway does."""
    require_ros("tf2_py")
    start = 1_000 * S
    fixed = said("base", "camera", 1.0, 0.0, start - 60 * S, static=True)
    told = [said("camera", "optical", 0.2, 0.3, start - 60 * S, static=True)]
    for n in range(20):
        told += [said("base", "camera", 10.0 + n, n / 10, start + 50 * n * MS), fixed]
    asked = [("base", "optical", start + 25 * n * MS) for n in range(-1, 40)]
    await assert_same(told, asked)


async def test_frames_that_move_and_frames_that_stand() -> None:
    require_ros("tf2_py")
    start = 1_000 * S
    told = [said("base", "lidar", 0.5, 1.0, 0, static=True)]
    for n in (0, 1, 3, 2, 4):  # one is late
        told.append(said("odom", "base", n, n / 7, start + 50 * n * MS))
        told.append(said("map", "odom", 3.0, -0.4 * n, start + 50 * n * MS))
    asked = [("map", "lidar", start + 10 * n * MS) for n in range(-1, 22)]
    asked += [("lidar", "odom", start + 60 * MS), ("lidar", "nowhere", start)]
    await assert_same(told, asked)
