"""Print what is in view of every camera of a fleet, as it changes.

python examples/class_lists.py [ROBOT_PATTERN], such as 'r*'; FLEETSIGHT_CONNECT says where the fleet is.
"""

import asyncio
import sys
from contextlib import suppress

import fleetsight


async def main(robot: str = "*") -> None:
    """Print a line whenever other classes, or another number of one, are in view of a camera."""
    before: dict[tuple[str, str], dict[str, int]] = {}
    async with fleetsight.connect() as fleet:
        async for seen in fleet.class_lists(robot):
            camera = (seen.header.robot, seen.header.camera)
            counts = {each.name: each.count for each in seen.classes}
            if counts != before.get(camera):
                before[camera] = counts
                print("/".join(camera), counts or "nothing", flush=True)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(main(*sys.argv[1:]))
