"""`fleetsight rules test`."""

import asyncio
import sys
from datetime import UTC, datetime

from schemas.alerts import AlertState
from schemas.printing import printable
from services.monitor.export.settings import epoch_ns
from services.monitor.history.engine import engine_of, file_of
from services.monitor.history.errors import HistoryError
from services.monitor.history.intervals import Interval
from services.monitor.history.store import Store
from services.monitor.history.tables import intervals, lasted
from services.monitor.inventory.settling import NS
from services.monitor.rules.loading import RuleFileError, load_rules
from services.monitor.rules.model import RuleBook
from services.monitor.rules.replay import caveats, replay
from services.monitor.rules.settings import RulesSettings


async def run(settings: RulesSettings) -> None:
    """Print what the rules would have made of history.

    Raises:
        HistoryError: the database cannot be read.
        RuleFileError: the rule file is wrong.
    """
    book = await asyncio.to_thread(_read, settings)
    file = file_of(engine_of(settings.history))
    if file is not None and not file.exists():
        raise HistoryError(f"{file} does not exist")
    store = await Store.open(settings.history)
    try:
        since_ns = 0 if settings.since is None else epoch_ns(settings.since)
        found = await store.select(Interval, lasted(intervals, since_ns))
    finally:
        await store.close()
    raised = 0
    for effect in replay(book, found):
        alert = effect.alert
        raised += effect.raised
        if alert.state in (AlertState.RAISED, AlertState.RESOLVED):
            moment = datetime.fromtimestamp(alert.changed_ns / NS, UTC).astimezone().isoformat(timespec="seconds")
            sys.stdout.write(printable(f"{moment} {alert.state} {alert.severity} {alert.rule}: {alert.text}") + "\n")
    sys.stdout.write(f"{len(book.rules)} rules, {len(found)} intervals, {raised} alerts\n")
    sys.stdout.writelines(f"{note}\n" for note in caveats(book))


def _read(settings: RulesSettings) -> RuleBook:
    try:
        return load_rules(settings.file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RuleFileError(None, reason, settings.file) from error
    except RuleFileError as error:
        raise error.of(settings.file) from error
