"""Debian's real ROS 1, started by tests: a rosmaster, and rospy scripts under the system's Python."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

from gateway.ros1.errors import Ros1Error
from gateway.ros1.master import MasterClient
from gateway.ros1.xmlrpc.client import XmlRpcClient
from tests.missing import require_debian
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

PEERS = Path(__file__).parent
"""Where the programs are that run under the system's Python."""

SYSTEM_PYTHON = "/usr/bin/python3"
ROSMASTER = "/usr/bin/rosmaster"
ROSTOPIC = "/usr/bin/rostopic"
_PACKAGES = Path("/usr/lib/python3/dist-packages")
_PROGRAMS = (ROSMASTER, ROSTOPIC, "/usr/bin/rosbag")
_PYTHON_PACKAGES = ("rospy", "sensor_msgs", "std_msgs")
END_TIMEOUT_S = 5.0
START_TIMEOUT_S = 60.0


def require_ros(*packages: str) -> None:
    """Skip the test where Debian's ROS is not installed; fail it in CI, where it has to be.

    packages: further ones, by the name of their Python module or by the path of a program.
    """
    modules = [str(_PACKAGES / package) for package in (*_PYTHON_PACKAGES, *packages)]
    require_debian("Debian's ROS", (*_PROGRAMS, *modules), how="tests/install/ros.sh installs it")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


class RosProcess:
    """One process of the real ROS; its output is collected while it runs."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._output = bytearray()
        self._reading = asyncio.ensure_future(self._read())

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def output(self) -> str:
        return self._output.decode(errors="replace")

    async def until_output(self, text: str) -> None:
        try:
            await until(lambda: text in self.output or self._process.returncode is not None, f"{text!r} is printed")
        finally:
            assert text in self.output, self.output

    async def finished(self) -> str:
        """Return the whole output once the process has ended by itself."""
        async with asyncio.timeout(START_TIMEOUT_S):
            await self._process.wait()
            await self._reading
        return self.output

    def kill(self) -> None:
        self._signal(signal.SIGKILL)

    def _signal(self, sign: signal.Signals) -> None:
        """Signal the process and those it started, as rosbag starts its player: the group is its own."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, sign)

    async def end(self, sign: signal.Signals = signal.SIGINT) -> None:
        """End the process: politely, then, past the deadline, not."""
        if self._process.returncode is None:
            self._signal(sign)
            with suppress(TimeoutError):
                async with asyncio.timeout(END_TIMEOUT_S):
                    await self._process.wait()
        self.kill()
        await self._process.wait()
        await self._reading

    async def _read(self) -> None:
        stream = self._process.stdout
        assert stream is not None
        while data := await stream.read(4096):
            self._output += data


class RosEnvironment:
    """Where rospy scripts run: against the given master, on the loopback, with their logs in a folder of the test's."""

    def __init__(self, folder: Path, *, master_uri: str = "") -> None:
        self.port = free_port()
        self.master_uri = master_uri or f"http://127.0.0.1:{self.port}/"
        self._folder = folder
        self._processes: list[RosProcess] = []
        self._master: RosProcess | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.gather(*(process.end(signal.SIGKILL) for process in self._processes))

    async def start_master(self) -> None:
        """Start the real rosmaster on this environment's port; returns when it answers."""
        self._master = await self.run(SYSTEM_PYTHON, ROSMASTER, "--core", "-p", str(self.port))
        async with XmlRpcClient(timeout=1.0) as client:
            api = MasterClient(client, uri=self.master_uri, caller_id="/test")
            async with asyncio.timeout(START_TIMEOUT_S):
                while not await _answers(api):  # noqa: ASYNC110 - another process
                    await asyncio.sleep(0.05)

    @property
    def master_pid(self) -> int:
        assert self._master is not None
        return self._master.pid

    async def end_master(self) -> None:
        """Kill the rosmaster; what it knew is lost."""
        assert self._master is not None
        await self._master.end(signal.SIGKILL)

    async def script(self, source: str, *arguments: str) -> RosProcess:
        """Start a rospy script."""
        return await self.run(SYSTEM_PYTHON, "-u", "-c", source, *arguments)

    async def rostopic(self, *arguments: str) -> RosProcess:
        return await self.run(SYSTEM_PYTHON, "-u", ROSTOPIC, *arguments)

    async def run(self, *command: str) -> RosProcess:
        process = await asyncio.create_subprocess_exec(
            *command,
            env=self._variables(),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )
        self._processes.append(RosProcess(process))
        return self._processes[-1]

    def _variables(self) -> dict[str, str]:
        return {
            "PATH": "/usr/bin:/bin",
            "HOME": str(self._folder),
            "ROS_HOME": str(self._folder),
            "ROS_LOG_DIR": str(self._folder),
            "ROS_MASTER_URI": self.master_uri,
            "ROS_IP": "127.0.0.1",
            "PYTHONUNBUFFERED": "1",
        }


async def _answers(master: MasterClient) -> bool:
    try:
        await master.get_pid()
    except Ros1Error:
        return False
    return True


@asynccontextmanager
async def real_master(folder: Path) -> AsyncIterator[RosEnvironment]:
    """An environment whose real rosmaster is up."""
    async with RosEnvironment(folder) as environment:
        await environment.start_master()
        yield environment
