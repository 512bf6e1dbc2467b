import os
from concurrent.futures import ThreadPoolExecutor

from gateway.scheduling import give_way


def after_giving_way() -> tuple[int, int]:
    """Return the policies of this thread and of one that it starts."""
    give_way()
    with ThreadPoolExecutor(1) as executor:
        return os.sched_getscheduler(0), executor.submit(os.sched_getscheduler, 0).result()


def test_a_thread_and_those_that_it_starts_give_way() -> None:
    with ThreadPoolExecutor(1) as executor:  # a policy is a thread's own
        assert executor.submit(after_giving_way).result() == (os.SCHED_BATCH, os.SCHED_BATCH)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_another_policy_is_kept() -> None:
    def idle() -> tuple[int, int]:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        return after_giving_way()

    with ThreadPoolExecutor(1) as executor:
        assert executor.submit(idle).result() == (os.SCHED_IDLE, os.SCHED_IDLE)
