"""ROS's own command-line arguments, which roslaunch gives to every node that it starts. Pure."""

from collections.abc import Iterator, Sequence
from typing import Final

REMAPPED: Final = ":="
OPTIONS: Final = {
    "__name": "node-name",
    "__ns": "namespace",
    "__master": "ros-master",
    "__ip": "ros-host",
    "__hostname": "ros-host",
}


def options_of(arguments: Sequence[str]) -> list[str]:
    """Return a command line in which ROS's arguments are the gateway's options.

    Arguments without a meaning here are left out: the place of a log file (`__log:=`), private parameters (`_rate:=5`).
    """
    return [option for argument in arguments for option in _options(argument)]


def _options(argument: str) -> Iterator[str]:
    name, is_remapped, value = argument.partition(REMAPPED)
    if not is_remapped or argument.startswith("-"):
        yield argument
    elif name in OPTIONS:
        yield f"--{OPTIONS[name]}={value}"
    elif not name.startswith("_"):
        yield f"--remap={name}={value}"
