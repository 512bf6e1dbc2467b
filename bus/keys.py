"""Key expressions, checked and matched by Zenoh's own rules."""

import zenoh

from bus.errors import BusError


def key_expression(text: str) -> str:
    """Return `text` if it is a key expression (`*` and `**` allowed).

    Raises:
        BusError: it is none.

    """
    try:
        return str(zenoh.KeyExpr(text))
    except (zenoh.ZError, UnicodeEncodeError) as error:
        raise BusError(f"{text!r} is not a key expression") from error


def single_key(text: str) -> str:
    """Return `text` if it is one single key.

    Raises:
        BusError: it is none, or it holds a wildcard.

    """
    if "*" in text:
        raise BusError(f"{text!r} has a wildcard; a single key is needed")
    return key_expression(text)


def is_single_key(text: str) -> bool:
    """Return whether `text` is one single key."""
    try:
        single_key(text)
    except BusError:
        return False
    return True


def matches(key_expr: str, other: str) -> bool:
    """Return whether two valid key expressions have a key in common."""
    return zenoh.KeyExpr(key_expr).intersects(other)


def whose(key: str) -> str:
    """Return the beginning of a key that says whose it is: `fleet/r1` of `fleet/r1/front/classes`."""
    return "/".join(key.split("/", 2)[:2])
