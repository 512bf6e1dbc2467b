import asyncio

from bus import Payload
from gateway.to_bus.shaping.uplink_pacer import Pacer
from tests.waiting import until

BYTES_PER_S = 100_000


async def test_what_fits_goes_at_once_and_the_rest_when_it_may() -> None:
    pacer, sent = Pacer(BYTES_PER_S * 8 / 1e6), list[Payload]()
    running = asyncio.create_task(pacer.run())
    older = b"o" * (BYTES_PER_S // 20)
    assert pacer.offer("color", bytes(BYTES_PER_S // 10), sent.append) == 0
    assert len(sent) == 1
    assert pacer.offer("color", older, sent.append) == 0
    assert pacer.offer("color", bytes(BYTES_PER_S // 10), sent.append) == 1
    pacer.charge(BYTES_PER_S // 20)
    assert len(sent) == 1
    await until(lambda: len(sent) == 2, "the newer one is sent")
    assert older not in sent
    running.cancel()
    await asyncio.wait([running])


async def test_it_sleeps_until_something_waits() -> None:
    pacer, sent = Pacer(BYTES_PER_S * 8 / 1e6), list[Payload]()
    running = asyncio.create_task(pacer.run())
    await asyncio.sleep(0)
    for _ in range(2):
        pacer.offer("color", bytes(BYTES_PER_S // 10), sent.append)
    await until(lambda: len(sent) == 2, "both are sent")
    running.cancel()
    await asyncio.wait([running])


async def test_what_is_discarded_is_never_sent() -> None:
    pacer, sent = Pacer(BYTES_PER_S * 8 / 1e6), list[Payload]()
    running = asyncio.create_task(pacer.run())
    pacer.charge(BYTES_PER_S)  # a second, as a busy machine may take a tenth of it for the next three lines
    pacer.offer("color", b"1" * 100, sent.append)
    pacer.offer("depth", b"2" * 100, sent.append)
    assert pacer.discard("color") == 1
    await until(lambda: sent, "the other one is sent")
    assert sent == [b"2" * 100]
    running.cancel()
    await asyncio.wait([running])
