"""A link that is thin, slow, loses packets, or is gone."""

import numpy as np
import pytest

from benchmarks.chaos.shaper import QUEUE_S, Conditions, Shaper, ports

PACKET = bytes(1_250)
"""10,000 bits: 5 ms at 2 Mbit/s."""

MBIT = 2.0


def shaper(even: float = 0.5, **conditions: object) -> Shaper:
    made = Shaper(lambda: even)
    made.conditions = Conditions(**conditions)  # type: ignore[arg-type]
    return made


def ipv4(source: int, destination: int) -> bytes:
    """Return the beginning of a TCP packet without options."""
    return bytes([0x45, *range(1, 20)]) + source.to_bytes(2) + destination.to_bytes(2) + bytes(16)


def test_a_good_link_hands_on_at_once() -> None:
    assert shaper().leaves_s(PACKET, 7.0) == 7.0


def test_a_link_that_is_down_loses_everything() -> None:
    link = shaper(up=False)
    assert link.leaves_s(PACKET, 0.0) is None
    assert link.lost == 1


def test_a_thin_link_sends_one_packet_after_the_other_and_drops_what_would_wait_too_long() -> None:
    link = shaper(mbit=MBIT)
    left = [link.leaves_s(PACKET, 0.0) for _ in range(100)]
    sent = [each for each in left if each is not None]
    assert sent == pytest.approx([0.005 * number for number in range(1, len(sent) + 1)])
    assert QUEUE_S - 0.006 < sent[-1] < QUEUE_S + 0.006
    assert link.lost == 100 - len(sent) > 0
    assert link.leaves_s(PACKET, 1.0) == pytest.approx(1.005)


def test_packets_are_lost_by_chance() -> None:
    link = Shaper(np.random.default_rng(1).random)
    link.conditions = Conditions(loss=0.1)
    lost = sum(link.leaves_s(PACKET, 0.0) is None for _ in range(10_000))
    assert 900 < lost < 1_100


@pytest.mark.parametrize(("even", "delay_s"), [(0.0, 0.05), (0.5, 0.1), (1.0, 0.15)])
def test_packets_are_delayed_evenly_around_the_delay(even: float, delay_s: float) -> None:
    link = shaper(even, delay_ms=100, jitter_ms=50)
    assert link.leaves_s(PACKET, 1.0) == pytest.approx(1.0 + delay_s)


def test_packets_keep_their_order_whatever_their_delays() -> None:
    link = Shaper(np.random.default_rng(1).random)
    link.conditions = Conditions(delay_ms=100, jitter_ms=50)
    left = [link.leaves_s(PACKET, number * 0.01) for number in range(1_000)]
    assert left == sorted(left, key=lambda each: each or 0.0)


def test_a_blocked_port_loses_what_goes_there_and_what_comes_from_there() -> None:
    link = shaper(blocked=7447)
    assert ports(ipv4(40_000, 7447)) == (40_000, 7447)
    assert [link.leaves_s(ipv4(*ends), 0.0) for ends in ((40_000, 7447), (7447, 40_000), (40_000, 7448))] == [
        None,
        None,
        0.0,
    ]
