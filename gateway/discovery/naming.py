"""What cameras are called that were found."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import count
from typing import Final

from gateway.discovery.reading import Path
from gateway.nodes import ros_chunk
from schemas.keys import RESERVED

UNNAMED: Final = "camera"
MAX_NAME: Final = 64


def name_cameras(paths: Iterable[Path], robot: str, given: Mapping[Path, str], taken: Iterable[str]) -> dict[Path, str]:
    """Return the name of every camera; those in `given` keep theirs, `taken` are nobody's.

    A name is the end of the camera's namespace, as much of it as tells it from the others. Of two names that ROS could
    not tell apart one gets a number.
    """
    names = dict(given)
    stems = {path: _stem(path, robot) for path in {*paths, *given}}
    tail = 0 if given else _common_tail(list(stems.values()))
    telling = {path: stem[: len(stem) - tail] for path, stem in stems.items()}
    ends = Counter(end for stem in telling.values() for end in _ends(stem))
    taken_on_ros = {ros_chunk(name) for name in (*given.values(), *taken)}
    for path in sorted(stems.keys() - names.keys(), key=lambda path: (len(path), path)):
        proposals = _proposals(path, telling[path], ends)
        names[path] = next(name for name in proposals if ros_chunk(name) not in taken_on_ros)
        taken_on_ros.add(ros_chunk(names[path]))
    return names


def _stem(path: Path, robot: str) -> Path:
    """Return the namespace less the robot's own, and less a node's that repeats what it is in, like zed/zed_node."""
    chunks = path[1:] if len(path) > 1 and path[0] == ros_chunk(robot) else path
    if len(chunks) > 1 and chunks[-1] == f"{chunks[-2]}_node":
        chunks = chunks[:-1]
    return chunks or (UNNAMED,)


def _common_tail(stems: Collection[Path]) -> int:
    """Return how many last chunks say nothing since all cameras share them."""
    distinct = set(stems)
    if len(distinct) < 2:
        return 0
    longest = min(len(stem) for stem in distinct) - 1
    return next((n for n in range(longest, 0, -1) if len({stem[-n:] for stem in distinct}) == 1), 0)


def _ends(stem: Path) -> Iterator[Path]:
    """Return its ends, the shortest first, itself being the last."""
    return (stem[-length:] for length in range(1, len(stem) + 1))


def _proposals(path: Path, stem: Path, ends: Mapping[Path, int]) -> Iterator[str]:
    yield from (_legal(end) for end in _ends(stem) if ends[end] == 1)
    yield from (_legal(stem), _legal(path))
    for number in count(2):
        yield f"{_legal(path)[: MAX_NAME - 6]}_{number}"


def _legal(chunks: Path) -> str:
    name = "_".join(chunks).strip("_")[:MAX_NAME] or UNNAMED
    return f"{name}_{UNNAMED}" if name in RESERVED else name
