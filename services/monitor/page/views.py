"""The pages that show what is looked at live: pictures, objects in 3D, the map."""

from fastapi import FastAPI
from starlette.routing import Route

from services.monitor.live_views.mjpeg import PATH, MjpegStreams
from services.monitor.live_views.views import Views
from services.monitor.monitor import Monitor
from services.monitor.page.camera import add_camera
from services.monitor.page.floor_plan import floor_plan_route
from services.monitor.page.map import add_map
from services.monitor.page.objects import add_objects


def add_views(app: FastAPI, monitor: Monitor) -> None:
    """Add the pages, and where browsers get pictures and the floor plan."""
    views = Views(monitor.bus)
    routes = [Route(PATH, MjpegStreams(views.pictures))]
    if monitor.floor_plan is not None:
        routes.append(floor_plan_route(monitor.floor_plan))
    app.router.routes[:0] = routes  # before the page, which takes the rest
    add_camera(monitor, views)
    add_objects(monitor, views)
    add_map(monitor, views)
