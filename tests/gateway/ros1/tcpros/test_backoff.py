"""Jitter is no secret, hence the plain generators."""
# ruff: noqa: S311

from __future__ import annotations

from random import Random

from gateway.ros1.tcpros.subscriber import Backoff


def test_delays_double_up_to_the_last_each_jittered_by_up_to_half() -> None:
    backoff = Backoff(Random(1), first=1.0, last=4.0)
    for full in (1.0, 2.0, 4.0, 4.0):
        assert full / 2 <= backoff.next_delay() <= full


def test_reset_starts_again() -> None:
    backoff = Backoff(Random(1), first=1.0, last=100.0)
    for _ in range(5):
        backoff.next_delay()
    backoff.reset()
    assert backoff.next_delay() <= 1.0


def test_two_nodes_do_not_retry_in_step() -> None:
    assert Backoff(Random(1)).next_delay() != Backoff(Random(2)).next_delay()
