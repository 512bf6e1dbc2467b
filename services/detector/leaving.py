"""When a worker has to be done once it leaves."""

import asyncio
from typing import Final

FINISH_S: Final = 1.2
"""How long what has begun may take to end once it is let go: less than whoever told the process to end may wait."""


class Leaving:
    """Whether a worker leaves. until_s: when it has to be done, by the loop's clock; None while it stays."""

    def __init__(self) -> None:
        self.until_s: float | None = None

    def begin(self) -> None:
        """Leave: begin nothing more."""
        if self.until_s is None:
            self.until_s = asyncio.get_running_loop().time() + FINISH_S
