"""What sends frames on Zenoh as the gateway does: at the same quality of service, giving way, and nothing else."""

from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from gateway.process import giving_way


@contextmanager
def sender(config: str, key: str) -> Iterator[zenoh.Publisher]:
    """Open a Zenoh session; publish on it what may be lost, behind everything else."""
    with giving_way(), zenoh.open(zenoh.Config.from_json5(config)) as session:
        yield session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )
