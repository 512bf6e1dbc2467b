import asyncio

import pytest

from bus.sharing import watchdog
from bus.sharing.watchdog import HUNG, PROMPT, StallDetector
from services.detector.model import ModelError, end_if_hung


async def test_a_model_that_answers_or_is_asked_nothing_is_not_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "CHECK_S", 0)
    looks = 0

    def pending() -> object:
        nonlocal looks
        looks += 1
        if looks < 3 * HUNG:
            return looks // HUNG
        return None if looks < 6 * HUNG else "the last one"

    with pytest.raises(ModelError, match=r"^yolo after 420 looks has not answered for 0 s$"):
        async with asyncio.timeout(60):
            await end_if_hung(lambda: f"yolo after {looks} looks", pending)
    assert looks == 7 * HUNG


def looks(*checks: int) -> list[bool]:
    detector = StallDetector()
    return [detector.look(each) for each in checks]


def test_a_call_that_does_not_answer_is_a_stall_until_answers_were_prompt_for_a_while() -> None:
    assert looks(0, 1, 2, 3) == [False, False, True, True]
    assert looks(0, 1, 2, *[0] * PROMPT) == [False, False, *[True] * PROMPT, False]


def test_work_whose_calls_always_take_long_does_not_stand_still() -> None:
    slow = [*range(8)] * 4
    assert looks(*slow)[8 + PROMPT :] == [False] * (len(slow) - 8 - PROMPT)
    assert looks(*slow, *range(20))[-1]


def test_calls_of_a_second_are_no_stall_after_one_that_took_longer() -> None:
    assert looks(0, 1, 2, 3, *[0, 1] * 10)[-10:] == [False] * 10
