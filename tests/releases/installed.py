"""A release's own code, installed from its record beside today's: its processes and its Python."""

import asyncio
import logging
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import venv
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

log = logging.getLogger(__name__)

TODAY: Final = (sys.executable, "-m", "fleetsight")
INHERITED: Final = ("FLEETSIGHT_", "PYTHON", "ROS_", "VIRTUAL_ENV")
ROOT: Final = Path(__file__).parents[2]
WEIGHTS: Final = ROOT / "services" / "detector" / "weights"
STOP_S: Final = 20


@dataclass(frozen=True, slots=True)
class Installed:
    """An environment with the release's code. Other packages and the detector's weights are today's."""

    python: str

    @classmethod
    def of(cls, release: Path, folder: Path) -> Self:
        """Install a recorded release into a new environment in a folder."""
        venv.create(folder, symlinks=True)
        python = f"{folder}/bin/python"
        (wheel,) = release.glob("*.whl")
        pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index")
        subprocess.run([*pip, str(wheel)], check=True, capture_output=True)
        (packages,) = folder.glob("lib/*/site-packages")
        for weights in WEIGHTS.iterdir():
            shutil.copy(weights, packages / WEIGHTS.relative_to(ROOT))
        (packages / "todays.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        return cls(python)

    @property
    def command(self) -> Sequence[str]:
        """The release's `fleetsight`."""
        return (self.python, "-m", "fleetsight")

    def run(self, *arguments: str, given: str = "") -> str:
        """Return the output of the release's Python."""
        done = subprocess.run(
            (self.python, *arguments),
            input=given,
            env=_outside(),
            cwd="/",
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{arguments}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout


def _outside() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(INHERITED)}
    return kept | {"FLEETSIGHT_CACHE": os.environ["FLEETSIGHT_CACHE"]}


@asynccontextmanager
async def process(command: Sequence[str], *arguments: str) -> AsyncIterator[list[str]]:
    """Run a process that runs on until the context ends, and stops in order then; yield the lines that it writes."""
    running = await asyncio.create_subprocess_exec(
        *command, *arguments, stdin=PIPE, stdout=PIPE, stderr=asyncio.subprocess.STDOUT, env=_outside(), cwd="/"
    )
    lines: list[str] = []

    async def read() -> None:
        assert running.stdout is not None
        async for line in running.stdout:
            lines.append(line.decode())
            log.info("%s: %s", arguments[0], lines[-1].rstrip())

    reading = asyncio.create_task(read())
    try:
        yield lines
        assert running.returncode is None, f"{arguments} ended: {''.join(lines)[-2000:]}"
    finally:
        if running.returncode is None:
            running.send_signal(signal.SIGTERM)
        try:
            await asyncio.wait_for(running.wait(), STOP_S)
        except TimeoutError:
            running.kill()
        await reading
    assert running.returncode == 0, f"{arguments}: {running.returncode}: {''.join(lines)[-2000:]}"
