"""A screen in memory (Xvfb), and what is to be seen on it."""

import asyncio
import signal
import struct
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tests.integration.peers.ros import RosEnvironment
from tests.waiting import until

XVFB: Final = "/usr/bin/Xvfb"
PATIENCE_S: Final = 30
TOLERANCE: Final = 12
HEADER: Final = struct.Struct(">25I")
COLOUR_BYTES: Final = 12


class Screen:
    """A screen of 800 x 600 pixels. display: its name for X programs."""

    def __init__(self, display: str, dump: Path) -> None:
        self.display = display
        self._dump = dump

    def pixels(self) -> NDArray[np.uint8]:
        """Return height x width x (red, green, blue) from the X window dump: a header, a table of colours, rows."""
        dump = self._dump.read_bytes()
        fields = HEADER.unpack_from(dump)
        size, width, height, row_bytes, colours = fields[0], fields[4], fields[5], fields[12], fields[19]
        rows = np.frombuffer(dump, np.uint8, height * row_bytes, size + colours * COLOUR_BYTES)
        return rows.reshape(height, row_bytes)[:, : width * 4].reshape(height, width, 4)[:, :, 2::-1]

    def count(self, color: Sequence[int]) -> int:
        """Return how many pixels are of about that red, green and blue."""
        far = np.abs(self.pixels().astype(int) - color).max(axis=2)
        return int((far <= TOLERANCE).sum())

    async def until_seen(self, *colors: Sequence[int], pixels: int) -> None:
        """Wait until there is enough of each colour on the screen."""
        async with asyncio.timeout(PATIENCE_S):
            while min(self.count(color) for color in colors) < pixels:  # noqa: ASYNC110 - another process draws
                await asyncio.sleep(0.2)


@asynccontextmanager
async def screen_in(ros: RosEnvironment, folder: Path) -> AsyncIterator[Screen]:
    """Switch a screen on; its dump is in the folder, which is there."""
    options = ("-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-fbdir", str(folder))
    server = await ros.run(XVFB, *options)
    await until(lambda: server.output.endswith("\n"), "the screen says its number")
    yield Screen(f":{server.output.split()[-1]}", folder / "Xvfb_screen0")
    await server.end(signal.SIGTERM)
