"""A program of the fleet that notes when each message of an image comes, in a process of its own. Argument: router.

Asked, it says what it saw of each image so far.
"""

import asyncio
import sys

import msgspec

from benchmarks.guide.observer import observing
from benchmarks.peers.answering import answer


async def run(router: str) -> None:
    """Observe until the standard input ends."""
    loop = asyncio.get_running_loop()
    async with observing(router) as observer:

        async def account() -> dict[str, object]:
            return {"seen": msgspec.to_builtins(observer.seen)}

        await asyncio.to_thread(answer, lambda: asyncio.run_coroutine_threadsafe(account(), loop).result())


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1]))
