from pathlib import Path

import msgspec

from schemas.alerts import AlertState
from services.monitor.history.archive import Archive
from services.monitor.history.store import Store
from services.monitor.web.pages.alerts import KeptAlerts
from tests.services.monitor.web.pages.rows.test_alert_rows import ALERT


async def test_why_there_are_none_is_said() -> None:
    assert "--history none" in (await KeptAlerts(Archive("none")).ended()).problem


async def test_only_what_ended_is_found(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.db'}"
    store = await Store.open(url)
    ended = msgspec.structs.replace(ALERT, id="2", state=AlertState.RESOLVED)
    await store.write([], [ALERT, ended], 1)
    await store.close()
    found = await KeptAlerts(Archive(url)).ended()
    assert [alert.id for alert in found.alerts] == ["2"]
    assert found.problem == ""
