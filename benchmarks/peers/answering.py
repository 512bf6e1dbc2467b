"""How a peer is asked: a line on its standard input is answered with a line of JSON."""

import json
import sys
from collections.abc import Callable, Mapping


def answer(account: Callable[[], Mapping[str, object]]) -> None:
    """Answer until the standard input ends."""
    obey(lambda _: account())


def obey(act: Callable[[str], Mapping[str, object]]) -> None:
    """Do what each line says, and answer, until the standard input ends."""
    for line in sys.stdin:
        print(json.dumps(act(line.strip())), flush=True)
