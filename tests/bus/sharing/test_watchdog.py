import asyncio

import pytest

from bus.sharing import watchdog
from bus.sharing.watchdog import HUNG
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
