"""The buffer of intervals: those that are open, and those to be written. Pure."""

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, Final, Self, TypeVar, cast

import msgspec
from msgspec.structs import replace

MAX_PENDING: Final = 200_000
"""How many intervals wait for a database that is gone; the oldest are given up for newer ones."""

SAME_NS: Final = 1_000_000_000
"""How far apart, in nanoseconds, two monitors may enter the same: each has a clock of its own."""


class StoredInterval(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """A state at one place without a gap. Times are epoch nanoseconds, ours. open: it continues."""

    since_ns: int
    until_ns: int
    open: bool

    @property
    def place(self) -> Hashable:
        """The place of the interval: at most one of each kind is open there at a time."""
        raise NotImplementedError

    def is_as(self, before: Self) -> bool:
        """Whether its content equals that of an earlier interval of its place; both merge over a short gap."""
        raise NotImplementedError

    def going_on_from(self, before: Self) -> Self:
        """Return both as one interval."""
        return replace(self, since_ns=before.since_ns)


L = TypeVar("L", bound=StoredInterval)

_At = tuple[type[StoredInterval], Hashable]
_Key = tuple[_At, int]


class IntervalBuffer:
    """Open intervals of each kind, and those to be written. lost: intervals dropped because too many waited."""

    def __init__(self) -> None:
        self._open: dict[_At, StoredInterval] = {}
        self._pending: dict[_Key, StoredInterval] = {}
        self.lost = 0

    def __len__(self) -> int:
        return len(self._pending)

    def opened(self, kind: type[L], place: Hashable) -> L | None:
        """Return the open interval of a place."""
        return cast("L | None", self._open.get((kind, place)))

    def begin(self, new: StoredInterval) -> None:
        """Open an interval; the open one of its place ends."""
        self.end(type(new), new.place, new.since_ns)
        self._open[_at(new)] = new
        self.note([new])

    def end(self, kind: type[StoredInterval], place: Hashable, until_ns: int, **changes: Any) -> None:
        """End the open interval of a place, if any. changes: fields to set at its end."""
        old = self._open.pop((kind, place), None)
        if old is not None:
            self.note([replace(old, until_ns=max(old.since_ns, until_ns), open=False, **changes)])

    def drop(self, kind: type[StoredInterval], place: Hashable) -> None:
        """Forget the open interval of a place: another monitor continues it."""
        self._open.pop((kind, place), None)

    def note(self, some: Iterable[StoredInterval]) -> None:
        """Queue intervals for writing in their current state."""
        for each in some:
            at = _key(each)
            if at not in self._pending and len(self._pending) >= MAX_PENDING:
                del self._pending[next(iter(self._pending))]
                self.lost += 1
            self._pending[at] = each

    def adopt(self, stored: Iterable[StoredInterval]) -> None:
        """Continue open intervals of the database, whose sightings the inventory has restored."""
        self._open.update((_at(each), each) for each in stored if each.open)

    def merge(
        self,
        stored: Sequence[StoredInterval],
        heartbeat_ns: int,
        gap_ns: int,
        *,
        followed: bool,
        ended_of: type[StoredInterval] | None = None,
    ) -> None:
        """Begin to write where another monitor, or this one, stopped at `heartbeat_ns`.

        stored: the intervals that are open in the database or ended lately. Stored and open intervals of equal content
        that overlap, or are at most `gap_ns` apart, are merged; intervals open only in the database ended at the
        heartbeat.
        followed: another one wrote until then, and so what ended by then, or came before what is open there.
        ended_of: the kind of which `stored` has all that ended within `gap_ns` before: if others of it ended by then,
        they came too late for the last write.
        """
        ours: dict[_At, list[StoredInterval]] = {_at(old): [] for old in stored}
        for (at, _), each in ({_key(of): of for of in self._open.values()} | self._pending).items():
            if at in ours:
                ours[at].append(each)
        merged: list[StoredInterval] = []
        going_on: list[StoredInterval] = []
        for old in stored:
            here = ours[_at(old)]
            same = _going_on(old, here, heartbeat_ns, gap_ns)
            if same is not None:
                going_on.append(same)
                here.remove(same)
                for each in here if followed else ():
                    if each.since_ns < same.since_ns:
                        self._pending.pop(_key(each), None)
                self._pending.pop(_key(same), None)
                merged.append(same.going_on_from(old))
                is_open = self._open.get(_at(old))
                if is_open is not None and is_open.since_ns == same.since_ns:
                    self._open[_at(old)] = is_open.going_on_from(old)
            elif old.open:
                ends_ns = [max(old.until_ns, heartbeat_ns), *(of.since_ns for of in here if of.since_ns > old.since_ns)]
                merged.append(replace(old, until_ns=min(ends_ns), open=False))
        if followed:
            until_ns = {_at(old): old.until_ns for old in sorted(stored, key=_until)}
            until_ns |= {_at(each): each.until_ns - SAME_NS for each in going_on if not each.open}
            self._pending = {
                key: each
                for key, each in self._pending.items()
                if each.open
                or each.until_ns > heartbeat_ns
                or (
                    isinstance(each, ended_of or ())
                    and _is_unwritten(each, until_ns.get(key[0]), heartbeat_ns - gap_ns)
                )
            }
        self.note(merged)
        self.note(self._open.values())

    def pending(self, at_most: int) -> Sequence[StoredInterval]:
        """Return the oldest intervals to be written."""
        return [each for each, _ in zip(self._pending.values(), range(at_most), strict=False)]

    def written(self, some: Iterable[StoredInterval]) -> None:
        """Remove intervals that were written, unless they changed meanwhile."""
        for each in some:
            at = _key(each)
            if self._pending.get(at) is each:
                del self._pending[at]

    def correct(self, corrected: Callable[[int], int]) -> None:
        """Correct all times of open and pending intervals."""
        self._open = {at: _corrected(each, corrected) for at, each in self._open.items()}
        pending = [_corrected(each, corrected) for each in self._pending.values()]
        self._pending = {_key(each): each for each in pending}

    def forget_pending(self, before_ns: int) -> None:
        """Forget open intervals and those that ended before then: another monitor writes them."""
        self._pending = {
            key: each for key, each in self._pending.items() if not each.open and each.until_ns >= before_ns
        }


def _corrected(of: StoredInterval, corrected: Callable[[int], int]) -> StoredInterval:
    names = [name for name in of.__struct_fields__ if name.endswith("_ns") and getattr(of, name) is not None]
    return replace(of, **{name: corrected(getattr(of, name)) for name in names})


def _at(of: StoredInterval) -> _At:
    return (type(of), of.place)


def _since(of: StoredInterval) -> int:
    return of.since_ns


def _until(of: StoredInterval) -> int:
    return of.until_ns


def _key(of: StoredInterval) -> _Key:
    return (_at(of), of.since_ns)


def _going_on(
    old: StoredInterval, here: Sequence[StoredInterval], heartbeat_ns: int, gap_ns: int
) -> StoredInterval | None:
    """Return which of those that are known here one of the database is, unless something else came in between."""
    found = min((each for each in here if _goes_on(each, old, heartbeat_ns, gap_ns)), key=_since, default=None)
    if found is None:
        return None
    between = (each for each in here if old.since_ns < each.since_ns < found.since_ns)
    return None if any(each.until_ns > heartbeat_ns for each in between) else found


def _is_unwritten(each: StoredInterval, until_ns: int | None, since_ns: int) -> bool:
    """Whether one that ended is not in the database. until_ns: of the last there of its place, if any since then."""
    return each.until_ns > since_ns and (until_ns is None or each.since_ns >= until_ns + SAME_NS)


def _goes_on(new: StoredInterval, old: StoredInterval, heartbeat_ns: int, gap_ns: int) -> bool:
    """Whether one that is known here is one of the database, as a monitor entered it that stopped at the heartbeat."""
    if new.since_ns == old.since_ns:
        return True
    by_ns = heartbeat_ns + gap_ns if old.open else old.until_ns
    return new.is_as(old) and new.since_ns <= by_ns and (new.open or new.until_ns >= old.since_ns)
