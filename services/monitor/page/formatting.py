"""Formats times, counts and ages for the page. Pure."""

from datetime import UTC, datetime
from typing import Final

from services.monitor.fleet import Age

NS: Final = 1_000_000_000
UNITS: Final = ((86_400.0, "d"), (3_600.0, "h"), (60.0, "min"), (1.0, "s"))
NEVER: Final = "never"
NOTHING: Final = "\N{EN DASH}"


def ago(then_ns: int, now_ns: int) -> str:
    """Return the age of a time in its largest unit; `never` for 0. Future times are now."""
    if not then_ns:
        return NEVER
    return f"{lasting((now_ns - then_ns) / NS)} ago" if now_ns - then_ns >= NS else "now"


def lasting(seconds: float) -> str:
    """Return a duration in whole units, of the largest that fits; 0 s below a second."""
    for size, unit in UNITS:
        if seconds >= size:
            return f"{int(seconds // size)} {unit}"
    return "0 s"


def age_text(age: Age | None) -> str:
    """Return an age, to a tenth of a second up to ten, with `>` where only a lower bound is known."""
    if age is None:
        return NOTHING
    bound = "" if age.exact else "> "
    return f"{bound}{age.seconds:.1f} s" if age.seconds < 10 else bound + lasting(age.seconds)


def brief(count: int) -> str:
    """Return a count in at most four characters up to a thousand million: 950, 1.2k, 34k, 5.6M."""
    for size, unit in ((1_000_000, "M"), (1_000, "k")):
        if count >= size:
            value = count / size
            return f"{value:.1f}{unit}" if value < 9.95 else f"{value:.0f}{unit}"
    return str(count)


def rate_text(hz: float) -> str:
    """Return a rate; an en dash if there is none."""
    return f"{hz:.1f}/s" if hz > 0 else NOTHING


def iso(at_ns: int) -> str:
    """Return a time as ISO 8601 in UTC with milliseconds, which the browser shows in its own zone; empty for 0."""
    if not at_ns:
        return ""
    return datetime.fromtimestamp(at_ns / NS, UTC).isoformat(timespec="milliseconds")


def plural(count: int, one: str, many: str = "") -> str:
    """Return a count and its noun: 1 camera, 2 cameras, 1,200 classes."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"
