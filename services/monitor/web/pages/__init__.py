"""The web page, made with nicegui."""

from fastapi import FastAPI
from nicegui import app as nicegui_app
from starlette.routing import Route

from services.monitor.live_views.newest import LiveViews
from services.monitor.monitor import Monitor
from services.monitor.web.pages.alerts import KeptAlerts, add_alerts
from services.monitor.web.pages.camera import add_camera
from services.monitor.web.pages.chart import Charts
from services.monitor.web.pages.frame import answer_instead
from services.monitor.web.pages.health import add_health
from services.monitor.web.pages.in_view import add_in_view
from services.monitor.web.pages.inventory import add_inventory
from services.monitor.web.pages.map import add_map, floor_plan_route
from services.monitor.web.pages.mjpeg import PATH, MjpegStreams
from services.monitor.web.pages.object_clouds import add_objects
from services.monitor.web.pages.overview import add_overview
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.wall import add_wall
from services.monitor.web.pages.warehouses import add_warehouses
from services.monitor.web.pages.world_object import add_world_object


def add_pages(app: FastAPI, monitor: Monitor) -> None:
    """Add every page. The server admits only visitors who are logged in."""
    answer_instead(nicegui_app)
    shared = PageData(monitor)
    add_overview(shared, monitor)
    add_wall(shared, monitor)
    charts = Charts(monitor.archive)
    add_inventory(charts, monitor)
    add_in_view(shared, charts, monitor)
    add_alerts(monitor, KeptAlerts(monitor.archive))
    add_health(shared, monitor)
    add_warehouses(monitor)
    _add_views(app, monitor)


def _add_views(app: FastAPI, monitor: Monitor) -> None:
    """Add the live pages, and the routes of pictures and floor plan."""
    views = LiveViews(monitor.bus, monitor.fleet.inventory.is_forgotten)
    routes = [Route(PATH, MjpegStreams(views.pictures))]
    if monitor.floor_plan is not None:
        routes.append(floor_plan_route(monitor.floor_plan))
    app.router.routes[:0] = routes  # before the page, which matches all other paths
    add_camera(monitor, views)
    add_objects(monitor, views)
    add_map(monitor, views)
    add_world_object(monitor, views)
