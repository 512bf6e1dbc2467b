"""The page that people look at, made with nicegui."""

from fastapi import FastAPI

from services.monitor.monitor import Monitor
from services.monitor.page.overview import add_overview
from services.monitor.page.shared import Shared


def add_pages(app: FastAPI, monitor: Monitor) -> None:  # noqa: ARG001 - nicegui's pages find their application themselves
    """Add every page. Whoever gets to one is logged in: the server sees to it."""
    shared = Shared(monitor)
    add_overview(monitor, shared)
