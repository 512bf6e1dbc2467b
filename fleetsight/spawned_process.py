"""For processes that multiprocessing spawns: importing this module has all our packages found first.

`begin` is to be a pool's initializer: it is loaded, and this module with it, before what else the process is given.
"""

from collections.abc import Callable

from fleetsight.own_packages import ALL, put_first

put_first(ALL)


def begin(prepare: Callable[[], None]) -> None:
    """Prepare the process, by a function of any of our packages."""
    prepare()
