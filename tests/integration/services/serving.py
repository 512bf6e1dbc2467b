"""Who serves which camera, as those see it who get the results."""

import asyncio
from collections.abc import Callable, Mapping

from bus import Subscription
from schemas import codec
from schemas.detections import ClassList
from schemas.distances import Distances
from schemas.objects import ObjectClouds
from tests.integration.fleet import PATIENCE_S

Result = ClassList | Distances | ObjectClouds


async def served(
    results: Subscription, schema: type[Result], so: Callable[[Mapping[str, str]], bool], *, in_a_row: int = 1
) -> dict[str, str]:
    """Take results until it is so whose they are, by `robot/camera`; that many in a row make a camera somebody's."""
    found: dict[str, tuple[str, int]] = {}
    async with asyncio.timeout(PATIENCE_S):
        while True:
            sample = await anext(results)
            seen = codec.decode(schema, sample.payload, sample.encoding)
            camera = f"{seen.header.robot}/{seen.header.camera}"
            before, count = found.get(camera, ("", 0))
            found[camera] = (seen.worker, count + 1 if seen.worker == before else 1)
            owners = {camera: worker for camera, (worker, count) in found.items() if count >= in_a_row}
            if so(owners):
                return owners
