"""Tell who asks what this machine's clock shows."""

import time
from collections.abc import Callable

from bus import Handler, Reply, Request
from bus.clocks import clock_id
from schemas import codec
from schemas.clock import ClockReading


def clock_handler(robot: str, boot_id: str, ros_ns: Callable[[], int | None]) -> Handler:
    """Return what answers requests for the robot's clock; `ros_ns` tells ROS time where it is not the system's."""
    name = clock_id()

    async def answer(request: Request) -> Reply:
        reading = ClockReading(
            robot=robot,
            boot_id=boot_id,
            clock_id=name,
            received_ns=request.received_ns,
            sent_ns=time.time_ns(),
            ros_ns=ros_ns(),
        )
        return Reply(codec.encode(reading), codec.encoding(ClockReading))

    return answer
