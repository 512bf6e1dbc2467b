"""Have a detector worker of the fleet say what is in an image file.

python examples/one_image.py photo.jpg; FLEETSIGHT_CONNECT says where the fleet is.
"""

import asyncio
import sys
from pathlib import Path

import fleetsight


async def main(image: bytes) -> None:
    """Print a line for each object, best score first."""
    async with fleetsight.connect() as fleet:
        found = await fleet.detect(image, timeout_s=30)
    for each in found.objects:
        box = each.box
        print(f"{each.name} {each.score:.2f} at {box.x1:.0f},{box.y1:.0f} to {box.x2:.0f},{box.y2:.0f} pixels")
    print(f"{len(found.objects)} objects by {found.model} of {found.worker}")


if __name__ == "__main__":
    try:
        asyncio.run(main(Path(sys.argv[1]).read_bytes()))
    except fleetsight.FleetsightError as error:
        sys.exit(str(error))
