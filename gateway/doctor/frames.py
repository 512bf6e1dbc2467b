"""Which frames of reference hang together. Pure."""

from collections.abc import Iterable


def connected(links: Iterable[tuple[str, str]], one: str, other: str) -> bool:
    """Return whether transforms lead from one frame to the other, each link being two frames' names.

    Older drivers write a slash before a frame's name; it means nothing.
    """
    neighbours: dict[str, set[str]] = {}
    for parent, child in links:
        neighbours.setdefault(_bare(parent), set()).add(_bare(child))
        neighbours.setdefault(_bare(child), set()).add(_bare(parent))
    seen, ahead = {_bare(one)}, [_bare(one)]
    while ahead:
        new = neighbours.get(ahead.pop(), set()) - seen
        seen |= new
        ahead += new
    return _bare(other) in seen


def _bare(frame: str) -> str:
    return frame.removeprefix("/")
