"""Write how far away the objects are that a fleet sees into a CSV file, until interrupted.

python examples/distances_to_csv.py distances.csv; FLEETSIGHT_CONNECT says where the fleet is.
"""

import asyncio
import csv
import sys
from contextlib import suppress
from pathlib import Path

import fleetsight

COLUMNS = ("stamp_s", "robot", "camera", "object", "track", "distance_m", "x_map_m", "y_map_m", "unknown")


def row(header: fleetsight.Header, each: fleetsight.ObjectDistance) -> list[object]:
    """Return one object's row: empty where something is not known, and why in the last column."""
    measured = each.measured
    places = {place.frame_id: place.at for place in measured.places} if measured else {}
    x, y, _ = places.get("map") or (None, None, None)
    axial_m = measured.axial_m if measured else None
    return [header.stamp_ns / 1e9, header.robot, header.camera, each.name, each.track, axial_m, x, y, each.unknown]


async def main(path: Path) -> None:
    """Write a row for each object; of frames that come too quickly the last 1,000 wait."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        async with fleetsight.connect() as fleet:
            frames = fleet.distances(keep=fleetsight.QUEUE(1_000))
            try:
                async for far in frames:
                    writer.writerows(row(far.header, each) for each in far.objects)
                    file.flush()
            finally:
                print(f"{frames.counts.received} frames, {frames.counts.dropped} of them dropped", file=sys.stderr)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(main(Path(sys.argv[1])))
