"""The page that people look at, made with nicegui."""

from fastapi import FastAPI, Request
from nicegui import ui

from services.monitor.monitor import Monitor
from services.monitor.web.auth.visitor import visitor_of


def add_pages(app: FastAPI, monitor: Monitor) -> None:  # noqa: ARG001 - nicegui's pages find their application themselves
    """Add every page. Whoever gets to one is logged in: the server sees to it."""

    @ui.page("/", title="fleetsight")
    async def overview(request: Request) -> None:
        picture = await monitor.picture()
        visitor = visitor_of(request)
        ui.label(f"{visitor.name}: {len(picture.robots)} robots, {len(picture.cameras)} cameras")
