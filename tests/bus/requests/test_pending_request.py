import asyncio
import threading

import pytest

from bus import BusClosedError, NotServedError, RefusedError, Reply
from bus.requests.pending_request import PendingRequest


def asking() -> PendingRequest:
    return PendingRequest("key", b"", "a/b", 10)


async def test_the_first_outcome_counts() -> None:
    asked = asking()
    asked.settle(Reply(b"first"))
    asked.settle(Reply(b"second"))
    asked.give_up()
    asked.refuse("late")
    assert await asked.answered() == Reply(b"first")
    asked.settle(Reply(b"later"))
    asked.end()


async def test_any_thread_may_bring_it() -> None:
    asked = asking()
    threading.Timer(0.01, asked.refuse, ("no",)).start()
    with pytest.raises(RefusedError, match=r"^no$"):
        await asked.answered()


async def test_nobody_and_nothing() -> None:
    asked = asking()
    asked.give_up()
    with pytest.raises(NotServedError):
        await asked.answered()
    asked = asking()
    asked.end()
    with pytest.raises(BusClosedError):
        await asked.answered()


async def test_an_error_that_nobody_takes_is_no_complaint_of_the_loop() -> None:
    complaints: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context))
    asked = asking()
    asked.refuse("no")
    await asyncio.sleep(0)
    del asked
    await asyncio.sleep(0)
    assert complaints == []
