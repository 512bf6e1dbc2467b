"""How a peer is asked: a line on its standard input is answered with a line of JSON."""

import json
import sys
from collections.abc import Callable, Mapping


def answer(account: Callable[[], Mapping[str, object]]) -> None:
    """Answer until the standard input ends."""
    for _ in sys.stdin:
        print(json.dumps(account()), flush=True)
