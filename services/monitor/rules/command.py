"""`fleetsight rules test`: replays a rule file over the history."""

import asyncio
import sys
from collections.abc import Iterator
from datetime import UTC, datetime

from schemas.alerts import AlertState
from schemas.printing import printable
from services.monitor.formats import epoch_ns
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import Presence
from services.monitor.history.store import Store
from services.monitor.history.tables import presence
from services.monitor.inventory.sighting import NS
from services.monitor.rules.loading import RuleFileError, load_rules
from services.monitor.rules.model import DisagreeRule, RuleBook, SilentRule
from services.monitor.rules.replay import caveats, replay
from services.monitor.rules.rule_file import text_of
from services.monitor.rules.timeline import FOREVER_NS, Timeline
from services.monitor.settings import RulesSettings


async def run(settings: RulesSettings) -> None:
    """Print the alerts that the rules would have raised over the history.

    Raises:
        HistoryError: the database cannot be read.
        RuleFileError: the rule file is wrong.
    """
    book = await asyncio.to_thread(_read, settings)
    store = await Store.open(settings.history, create=False)
    try:
        since_ns = 0 if settings.since is None else epoch_ns(settings.since)
        past = await _past(store, since_ns)
    finally:
        await store.close()
    raised = 0
    for effect in replay(book, past):
        alert = effect.alert
        raised += effect.raised
        if alert.state in (AlertState.RAISED, AlertState.RESOLVED):
            sys.stdout.write(
                printable(f"{_moment(alert.changed_ns)} {alert.state} {alert.severity} {alert.rule}: {alert.text}")
                + "\n"
            )
    sys.stdout.write(f"{len(book.rules)} rules, {len(past.intervals)} intervals, {raised} alerts\n")
    sys.stdout.writelines(f"{note}\n" for note in [*caveats(book), *_untold(book, past, since_ns)])


async def _past(store: Store, since_ns: int) -> Timeline:
    runs, there = presence.c.robot == "", presence.c.robot != ""  # separately, so that no run is cut off by the limit
    return Timeline(
        await store.select(Interval, since_ns=since_ns),
        [
            *await store.select(Presence, runs, since_ns=since_ns),
            *await store.select(Presence, there, since_ns=since_ns),
        ],
        await store.select(Disagreement, since_ns=since_ns),
    )


def _untold(book: RuleBook, past: Timeline, since_ns: int) -> Iterator[str]:
    """Yield a note about the part of the history that has no recorded presence."""
    tried = any(isinstance(rule, SilentRule | DisagreeRule) for rule in book.rules)
    if tried and max(since_ns, past.first_ns) < past.told_ns:
        when = "not tried:" if past.told_ns == FOREVER_NS else f"tried from {_moment(past.told_ns)} on: before,"
        yield f"silent, disagree: {when} the history has no presence or disagreements"


def _moment(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns / NS, UTC).astimezone().isoformat(timespec="seconds")


def _read(settings: RulesSettings) -> RuleBook:
    try:
        return load_rules(text_of(settings.file))
    except RuleFileError as error:
        raise error.of(settings.file) from error
