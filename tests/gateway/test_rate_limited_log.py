import logging

import pytest

from gateway.rate_limited_log import EVERY_S, RateLimitedLog


def test_a_kind_is_said_once_in_a_while_with_how_often_it_was_not(caplog: pytest.LogCaptureFixture) -> None:
    now_s = 100.0
    log = RateLimitedLog(logging.getLogger("test"), lambda: now_s)
    for frame in range(4):
        log.warning("%s: left out: %s", "/front", frame)
    log.warning("%s: 100 %% refused", "/front")
    now_s += EVERY_S - 0.1
    log.warning("%s: left out: %s", "/front", 4)
    assert caplog.messages == ["/front: left out: 0", "/front: 100 % refused"]
    now_s += 0.1
    log.warning("%s: left out: %s", "/front", 5)
    log.warning("%s: 100 %% refused", "/front")
    assert caplog.messages[2:] == [
        "/front: left out: 5 (and 4 more since the last such line)",
        "/front: 100 % refused",
    ]
