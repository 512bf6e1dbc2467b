"""A whole fleet under access rules, as the page on security says: each does its work, and no other's."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import TypeVar

import pytest

import fleetsight
from bus import BusSettings, QoS, open_bus
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey, Stream
from services.access.process import run_access, run_pki
from services.access.settings import AccessSettings, PkiSettings
from services.toolbox.demo.children import child, free_ports
from tests.gateway.to_ros.lists import class_list

log = logging.getLogger(__name__)

PATIENCE_S = 90
FLEET = """
robots: [r1, r2]
roles:
  central: [monitor, worldmodel]
  gpu1: detector
  ann: operator
  wall: observer
"""
T = TypeVar("T")


class Fleet:
    """Where the certificates are, and the monitor."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        self.folder = folder
        self.endpoint = endpoint

    def files(self, name: str) -> dict[str, Path]:
        return {
            "tls_ca": self.folder / "pki/ca.pem",
            "tls_certificate": self.folder / f"pki/{name}.pem",
            "tls_key": self.folder / f"pki/{name}.key",
        }

    def settings(self, name: str) -> BusSettings:
        return BusSettings.model_validate({"connect": [self.endpoint], **self.files(name)})

    def options(self, name: str) -> list[str]:
        return [
            word for option, file in self.files(name).items() for word in (f"--{option.replace('_', '-')}", str(file))
        ]


async def make(folder: Path) -> None:
    """Make certificates and rules by the commands."""
    await run_pki(PkiSettings(task="init", folder=folder / "pki"))
    for name in ("central", "r1", "r2", "gpu1", "ann", "wall"):
        await run_pki(PkiSettings(task="issue", name=name, folder=folder / "pki"))
    (folder / "fleet.yaml").write_text(FLEET)
    await run_access(AccessSettings(fleet=folder / "fleet.yaml", to=folder / "access.json", folder=folder / "pki"))


@pytest.fixture
async def fleet(tmp_path: Path) -> AsyncIterator[Fleet]:
    """A monitor, a simulated robot with its gateway and its distance service, a detector and a world model."""
    await make(tmp_path)
    central, near, master, web = (free_ports(1) for _ in range(4))
    made = Fleet(tmp_path, f"tls/127.0.0.1:{central}")
    joined = ["--connect", made.endpoint]
    processes: Sequence[Sequence[str]] = (
        [
            *(
                "monitor",
                "--listen",
                made.endpoint,
                "--access",
                str(tmp_path / "access.json"),
                *made.options("central"),
            ),
            *("--history", "none", "--web-port", str(web)),
        ],
        ["simulate", "--master-port", str(master), "--width", "320", "--height", "240"],
        [
            *("gateway", "--robot", "r1", "--ros-master", f"http://127.0.0.1:{master}", "--ros-host", "127.0.0.1"),
            *("--listen", f"tcp/127.0.0.1:{near}", *joined, *made.options("r1")),
        ],
        ["distance", "--robots", "r1", "--connect", f"tcp/127.0.0.1:{near}"],
        ["detector", "--runtime", "torch", *joined, *made.options("gpu1")],
        ["worldmodel", *joined, *made.options("central")],
    )
    async with AsyncExitStack() as stack:
        for arguments in processes:
            await stack.enter_async_context(child(arguments[0], arguments, log.info))
        yield made


@asynccontextmanager
async def joined(fleet: Fleet, name: str) -> AsyncIterator["fleetsight.Fleet"]:
    async with fleetsight.connect(settings=fleet.settings(name), within_s=PATIENCE_S) as member:
        yield member


async def first(stream: AsyncIterator[T]) -> T:
    async with asyncio.timeout(PATIENCE_S):
        return await anext(stream)


async def answered(ask: Callable[[], Awaitable[T]], has: Callable[[T], object]) -> T:
    """Ask until an answer has what is looked for."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(fleetsight.FleetsightError):
                if has(answer := await ask()):
                    return answer
            await asyncio.sleep(0.2)


@pytest.mark.timeout(300)
async def test_each_does_its_work_and_nobody_speaks_for_another(fleet: Fleet) -> None:
    async with joined(fleet, "ann") as operator, joined(fleet, "wall") as observer:
        seen = await first(aiter(operator.class_lists(robot="r1")))
        assert seen.worker.startswith("gpu1-")
        assert (await first(aiter(observer.class_lists()))).header.robot == "r1"
        measured = await first(aiter(operator.distances(robot="r1")))
        assert measured.worker.startswith("r1-")
        await answered(operator.inventory, lambda answer: answer.sightings)
        await answered(operator.world, lambda answer: answer.objects)
        assert await observer.robots().present() == frozenset()
        with pytest.raises(fleetsight.FleetsightError):
            await observer.inventory()

        forged = class_list(("box", 9), camera="camera")
        async with (
            open_bus(fleet.settings("r2")) as other,
            other.publisher(
                CameraKey("r1", "camera").stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList)
            ) as publisher,
        ):
            lists = aiter(operator.class_lists(robot="r1"))
            for _ in range(10):
                publisher.put(codec.encode(forged))
                assert (await first(lists)).worker.startswith("gpu1-")


async def test_the_rules_are_json_that_a_router_of_zenohs_own_takes_too(tmp_path: Path) -> None:
    await make(tmp_path)
    rules = json.loads((tmp_path / "access.json").read_bytes())
    assert rules["default_permission"] == "deny"
    assert {subject["id"] for subject in rules["subjects"]} == {"r1", "r2", "central", "gpu1", "ann", "wall"}
