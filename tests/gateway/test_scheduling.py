import errno
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from gateway.process import giving_way


def in_a_thread(look: Callable[[], list[int]]) -> list[int]:
    """Look in a thread of its own, for that is what has a policy; it begins with the usual one."""

    def begin() -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    with ThreadPoolExecutor(1, initializer=begin) as executor:
        return executor.submit(look).result()


def policies() -> list[int]:
    """Return the policies of this thread while it gives way, of one that it starts then, and of its own afterwards."""
    with giving_way(), ThreadPoolExecutor(1) as executor:
        seen = [os.sched_getscheduler(0), executor.submit(os.sched_getscheduler, 0).result()]
    return [*seen, os.sched_getscheduler(0)]


def test_a_thread_and_those_that_it_starts_give_way() -> None:
    assert in_a_thread(policies) == [os.SCHED_BATCH, os.SCHED_BATCH, os.SCHED_OTHER]


def test_another_policy_is_kept() -> None:
    def idle() -> list[int]:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        return policies()

    assert in_a_thread(idle) == [os.SCHED_IDLE] * 3


@pytest.mark.parametrize("number", [errno.EPERM, errno.EINVAL, errno.ENOSYS])
@pytest.mark.parametrize("call", ["sched_getscheduler", "sched_setscheduler"])
def test_where_a_sandbox_refuses_it_everything_else_goes_on(call: str, number: int) -> None:
    def refuse(*_: object) -> int:
        raise OSError(number, "on purpose")

    def look() -> list[int]:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(os, call, refuse)
            with giving_way():
                pass
        return [os.sched_getscheduler(0)]

    assert in_a_thread(look) == [os.SCHED_OTHER]
