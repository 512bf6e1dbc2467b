from collections.abc import Iterable, Iterator

from sqlalchemy import select

from schemas.alerts import Alert, AlertState
from services.monitor.history.tables import webhook_backlog
from services.monitor.history.webhook_backlog import BacklogWriter
from tests.schemas.results import alert
from tests.services.monitor.history.test_store import opened


class WebhookBacklog:
    """Owes some alerts to one webhook. asked: how often it was asked which."""

    def __init__(self) -> None:
        self.alerts: list[Alert] = []
        self.changes = 0
        self.asked = 0

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        self.alerts = [each for _, each in alerts]
        self.changes += 1

    def owed(self) -> Iterator[tuple[str, Alert]]:
        self.asked += 1
        return (("ops", each) for each in self.alerts)

    def owed_changes(self) -> int:
        return self.changes


async def test_what_is_owed_is_looked_at_when_it_changed_and_after_the_database_was_gone(url: str) -> None:
    owing = WebhookBacklog()
    owed = BacklogWriter(owing)
    async with opened(url) as store:
        await store.write([], [alert()], 9)
        owing.owe([("ops", alert())])
        for _ in range(3):
            await owed.write(store, owed.snapshot())
        assert (owing.asked, (await store.load(0)).owed) == (1, [("ops", alert())])
        await store.owe([], [("ops", "a1")])
        owed.begin([], leads=True)
        await owed.write(store, owed.snapshot())
        assert (owing.asked, (await store.load(0)).owed) == (2, [("ops", alert())])
        owing.owe([])
        await owed.write(store, owed.snapshot())
        assert (await store.load(0)).owed == []


async def test_an_alert_raised_while_others_are_written_is_owed_once_it_is_written_too(url: str) -> None:
    owing = WebhookBacklog()
    owed = BacklogWriter(owing)
    async with opened(url) as store:
        owing.owe([("ops", alert())])
        before = owed.snapshot()
        owing.owe([("ops", alert()), ("ops", alert(id_="a2"))])
        await store.write([], [alert()], 9)
        await owed.write(store, before)
        async with store._connection.begin():
            rows = (await store._connection.scalars(select(webhook_backlog.c.alert_id))).all()
        assert rows == ["a1"]  # one without its alert would be deleted by upkeep
        await store.write([], [alert(id_="a2")], 9)
        await owed.write(store, owed.snapshot())
        assert {each.id for _, each in (await store.load(0)).owed} == {"a1", "a2"}


async def test_what_is_owed_of_an_alert_is_forgotten_with_it(url: str) -> None:
    over = alert(id_="over", state=AlertState.RESOLVED, changed_ns=5)
    async with opened(url) as store:
        await store.write([], [over, alert()], 9)
        await store.owe([("ops", over), ("ops", alert())], [])
        assert await store.prune(8)
        async with store._connection.begin():
            left = (await store._connection.scalars(select(webhook_backlog.c.alert_id))).all()
        assert left == ["a1"]
