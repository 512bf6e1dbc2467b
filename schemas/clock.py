"""ClockReading: a robot's clocks, for measuring their offset."""

from typing import Annotated

import msgspec

from schemas.header import Name, Nanoseconds


class ClockReading(msgspec.Struct, frozen=True, kw_only=True):
    """A gateway's answer to an empty request.

    boot_id: the gateway process. clock_id: names the machine's system clock. received_ns, sent_ns: that clock when the
    request arrived and when the answer left, nanoseconds since the epoch. ros_ns: ROS time when the answer left where
    it is not the system clock (/use_sim_time).
    """

    robot: Name
    boot_id: Annotated[str, msgspec.Meta(max_length=64)]
    clock_id: Annotated[str, msgspec.Meta(max_length=64)]
    received_ns: Nanoseconds
    sent_ns: Nanoseconds
    ros_ns: Nanoseconds | None = None
