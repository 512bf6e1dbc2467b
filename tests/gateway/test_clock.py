import time

import pytest

from bus import Request
from bus.clocks import clock_id
from gateway.requests import clock_handler
from schemas import codec
from schemas.status import ClockReading


@pytest.mark.parametrize("ros_ns", [None, 5])
async def test_a_reading_says_when_it_was_asked_for_and_given(ros_ns: int | None) -> None:
    handler = clock_handler("r1", "boot", lambda: ros_ns)
    before = time.time_ns()
    reply = await handler(Request("fleet/r1/clock", b"", "", before))
    reading = codec.decode(ClockReading, reply.payload, reply.encoding)
    assert (reading.robot, reading.boot_id, reading.clock_id, reading.ros_ns) == ("r1", "boot", clock_id(), ros_ns)
    assert reading.received_ns == before <= reading.sent_ns <= time.time_ns()
