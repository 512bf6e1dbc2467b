from __future__ import annotations

import pytest

from gateway.ros1.msg.codec import compiled
from gateway.ros1.msg.known_messages import DEFINITIONS, SERVICES


def test_services_have_a_request_and_a_response() -> None:
    assert {"std_srvs/Empty", "std_srvs/SetBool", "std_srvs/Trigger"} == SERVICES
    assert {f"{name}{part}" for name in SERVICES for part in ("Request", "Response")} < DEFINITIONS.keys()


@pytest.mark.parametrize("name", DEFINITIONS)
def test_everything_can_be_compiled(name: str) -> None:
    assert compiled(DEFINITIONS, name).make.__name__ == name.partition("/")[2]
