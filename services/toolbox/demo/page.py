"""The demo's page, with its own history, a user to log in as, and a free port."""

import asyncio
import secrets
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.passwords import Passwords
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Role, User
from services.monitor.web.process import Web, WebError
from services.simulator.fleet import warehouse_seed
from services.simulator.floor_plan import write_floor_plan
from services.toolbox.demo.settings import SEED

NAME: Final = "demo"
RULES: Final = Path(__file__).parent / "rules.yaml"


@dataclass(frozen=True, slots=True)
class Page:
    """A monitor's settings, its web server, and how to log in."""

    settings: MonitorSettings
    web: Web
    note: str

    @classmethod
    async def of(cls, endpoint: str, folder: Path) -> Self:
        """Make the page for a demo whose bus listens at `endpoint`; `folder` holds its data."""
        history, password = f"sqlite:///{folder / 'history.db'}", secrets.token_urlsafe(9)
        hashed = await Passwords().hash(password)
        await UserStore(history).add(User(NAME, Role.OPERATOR, hashed, time.time_ns()))
        floor_plan = folder / "map.yaml"
        await asyncio.to_thread(write_floor_plan, floor_plan, warehouse_seed(SEED))
        settings = MonitorSettings(listen=[endpoint], history=history, rules=RULES, floor_plan=floor_plan)
        try:
            web = Web.of(settings)
        except WebError:
            settings = settings.model_copy(update={"web_port": 0})
            web = Web.of(settings)
        return cls(settings, web, f"page: {web.url} (log in as {NAME} with {password})")
