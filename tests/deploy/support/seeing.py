"""A router that says whose images come, as the monitor of a robot's gateway would."""

import subprocess
import sys
from typing import Final

from tests.deploy.support.machine import ROOT

SEE: Final = """
import asyncio, sys
from bus import LATEST, BusSettings, open_bus
from schemas import codec
from schemas.image import ImageFrame

async def main():
    async with (
        open_bus(BusSettings(mode="router", listen=[sys.argv[1]])) as bus,
        bus.subscribe("fleet/r1/camera/color", LATEST) as images,
    ):
        async for sample in images:
            image = codec.decode(ImageFrame, sample.payload, sample.encoding)
            print(image.header.robot, image.width, image.height, flush=True)

asyncio.run(main())
"""


def simulator(*options: str, network: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
    """Start a simulated robot with a camera. network: a command that enters the network it is to be in."""
    command = [*network, sys.executable, "-m", "services.toolbox", "simulate", "--streams", "color", *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, text=True, cwd=ROOT)


def seeing(endpoint: str, network: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
    """Start a router at an endpoint, which prints the robot and the size of each image that comes from r1."""
    command = [*network, sys.executable, "-c", SEE, endpoint]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
