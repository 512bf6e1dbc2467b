"""How a long run says how far it is."""

from typing import Protocol


class Progress(Protocol):
    """Called as `progress(stage, done, total)`; `done` counts up to `total` within each stage.

    What it raises ends the run, which can be taken up again later.
    """

    def __call__(self, stage: str, done: int, total: int, /) -> None: ...
