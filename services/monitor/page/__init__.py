"""The web page, made with nicegui."""

from fastapi import FastAPI
from nicegui import app as nicegui_app
from starlette.routing import Route

from services.monitor.live_views.newest import Views
from services.monitor.monitor import Monitor
from services.monitor.page.alerts import KeptAlerts, add_alerts
from services.monitor.page.camera import add_camera
from services.monitor.page.chart import Charts
from services.monitor.page.health import add_health
from services.monitor.page.inventory import add_inventory
from services.monitor.page.map import add_map, floor_plan_route
from services.monitor.page.mjpeg import PATH, MjpegStreams
from services.monitor.page.objects import add_objects
from services.monitor.page.open_pages import answer_instead
from services.monitor.page.overview import add_overview
from services.monitor.page.page_data import Shared
from services.monitor.page.wall import add_wall


def add_pages(app: FastAPI, monitor: Monitor) -> None:
    """Add every page. The server admits only visitors who are logged in."""
    answer_instead(nicegui_app)
    shared = Shared(monitor)
    add_overview(shared, monitor)
    add_wall(shared, monitor)
    add_inventory(shared, Charts(monitor.archive), monitor)
    add_alerts(monitor, KeptAlerts(monitor.archive))
    add_health(shared, monitor)
    _add_views(app, monitor)


def _add_views(app: FastAPI, monitor: Monitor) -> None:
    """Add the live pages, and the routes of pictures and floor plan."""
    views = Views(monitor.bus, monitor.fleet.inventory.is_forgotten)
    routes = [Route(PATH, MjpegStreams(views.pictures))]
    if monitor.floor_plan is not None:
        routes.append(floor_plan_route(monitor.floor_plan))
    app.router.routes[:0] = routes  # before the page, which matches all other paths
    add_camera(monitor, views)
    add_objects(monitor, views)
    add_map(monitor, views)
