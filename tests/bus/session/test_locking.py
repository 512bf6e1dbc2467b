import subprocess
import sys

import pytest

from tests.contract.conftest import free_endpoint

UNPRIVILEGED = """
import asyncio
import os
import resource
import sys
from bus import LATEST, BusSettings, QoS, open_bus
from bus.session.process_limits import SHAREABLE_BYTES, may_lock
if os.geteuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_MEMLOCK, (min(limit, 4096), limit))
"""
LOCKS = "print(may_lock(limit), may_lock(limit + 4096), may_lock(limit))"
SENDS = """
async def main() -> None:
    wanted = asyncio.Event()
    async with asyncio.timeout(20), open_bus(BusSettings(mode="router", listen=[sys.argv[2]])) as here:
        async with (
            open_bus(BusSettings(connect=[sys.argv[2]])) as there,
            there.publisher("picture", QoS.IMAGE, on_demand=lambda demand: demand and wanted.set()) as sending,
            here.subscribe("picture", LATEST) as arriving,
        ):
            await wanted.wait()
            for number in range(3):
                sending.put(bytes(6 << 20) + bytes([number]))
                print((await anext(arriving)).payload[-1])

asyncio.run(main())
"""


def as_nobody(program: str, limit: int, *arguments: str) -> list[str]:
    command = [sys.executable, "-c", UNPRIVILEGED + program, str(limit), *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.split()


@pytest.mark.parametrize("limit", [4096, 8 << 20])
def test_what_may_be_locked_is_the_hard_limit_at_most(limit: int) -> None:
    assert as_nobody(LOCKS, limit) == ["True", "False", "True"]


def test_large_messages_arrive_where_little_memory_may_be_locked() -> None:
    assert as_nobody(SENDS, 8 << 20, free_endpoint()) == ["0", "1", "2"]
