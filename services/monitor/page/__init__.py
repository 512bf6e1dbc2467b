"""The page that people look at, made with nicegui."""

from fastapi import FastAPI
from starlette.routing import Route

from services.monitor.looking.motion import PATH, MotionPictures
from services.monitor.looking.views import Views
from services.monitor.monitor import Monitor
from services.monitor.page.camera import add_camera
from services.monitor.page.map import add_map
from services.monitor.page.objects import add_objects
from services.monitor.page.overview import add_overview
from services.monitor.page.shared import Shared


def add_pages(app: FastAPI, monitor: Monitor) -> None:
    """Add every page. Whoever gets to one is logged in: the server sees to it."""
    shared = Shared(monitor)
    add_overview(monitor, shared)
    views = Views(monitor.bus)
    app.router.routes.insert(0, Route(PATH, MotionPictures(views.pictures)))  # before the page's, which are the rest
    add_camera(monitor, views)
    add_objects(monitor, views)
    add_map(monitor, views)
