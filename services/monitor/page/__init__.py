"""The page that people look at, made with nicegui."""

from fastapi import FastAPI
from nicegui import app as nicegui_app

from services.monitor.monitor import Monitor
from services.monitor.page.alerts import add_alerts
from services.monitor.page.chart import Charts
from services.monitor.page.error_pages import answer_instead
from services.monitor.page.health import add_health
from services.monitor.page.inventory import add_inventory
from services.monitor.page.kept_alerts import KeptAlerts
from services.monitor.page.overview import add_overview
from services.monitor.page.shared import Shared
from services.monitor.page.views import add_views


def add_pages(app: FastAPI, monitor: Monitor) -> None:
    """Add every page. Whoever gets to one is logged in: the server sees to it."""
    answer_instead(nicegui_app)
    shared = Shared(monitor)
    add_overview(shared, monitor)
    add_inventory(shared, Charts(monitor.archive), monitor)
    add_alerts(monitor, KeptAlerts(monitor.archive))
    add_health(shared, monitor)
    add_views(app, monitor)
