"""A window in which Open3D draws clouds."""

from typing import Any, Final

from services.toolbox.clouds.drawing import Drawing
from services.toolbox.errors import ViewerError

WIDTH: Final = 1280
HEIGHT: Final = 800
POINT_PIXELS: Final = 3.0
FRONT: Final = (-1.0, 0.0, 0.4)
OPTICAL_FRONT: Final = (0.0, 0.0, -1.0)
TILTED: Final = 0.5
BOX_RGB: Final = (1.0, 0.6, 0.0)
BACKGROUND_RGB: Final = (0.08, 0.08, 0.1)


class CloudWindow:
    """An open window; the view stays as the user turned it when other clouds are shown.

    Raises:
        ModuleNotFoundError: Open3D is not installed.
        ViewerError: it cannot be used here, or there is no display.
    """

    def __init__(self, title: str) -> None:
        self._open3d = _open3d()
        self._window = self._open3d.visualization.Visualizer()
        if not self._window.create_window(title, WIDTH, HEIGHT):
            raise ViewerError("no window can be opened: no display; set DISPLAY or WAYLAND_DISPLAY")
        options = self._window.get_render_option()
        options.point_size = POINT_PIXELS
        options.background_color = BACKGROUND_RGB
        self._points = self._open3d.geometry.PointCloud()
        self._boxes = self._open3d.geometry.LineSet()
        self._is_empty = True

    def show(self, drawing: Drawing) -> None:
        """Replace the drawn shapes."""
        vectors = self._open3d.utility
        self._points.points = vectors.Vector3dVector(drawing.xyz)
        self._points.colors = vectors.Vector3dVector(drawing.rgb)
        self._boxes.points = vectors.Vector3dVector(drawing.corners)
        self._boxes.lines = vectors.Vector2iVector(drawing.edges)
        self._boxes.paint_uniform_color(BOX_RGB)
        for shape in (self._points, self._boxes):
            if not self._is_empty:
                self._window.update_geometry(shape)
            elif len(drawing.xyz):
                self._window.add_geometry(shape)
        if self._is_empty and len(drawing.xyz):
            self._is_empty = False
            self._look(drawing.up)

    def _look(self, up: tuple[float, float, float]) -> None:
        """Set the view to the sensor's: along z where y is down, as in optical frames of cameras, else along x."""
        control = self._window.get_view_control()
        control.set_front(OPTICAL_FRONT if up[1] < -TILTED else FRONT)
        control.set_up(up)

    def turn(self) -> bool:
        """Process the user's input; return False once the window is closed."""
        going_on = bool(self._window.poll_events())
        self._window.update_renderer()
        return going_on

    def close(self) -> None:
        self._window.destroy_window()


def _open3d() -> Any:
    try:
        import open3d  # noqa: PLC0415 - takes seconds, and saving needs none of it
    except ModuleNotFoundError:
        raise
    except ImportError as error:
        raise ViewerError(f"Open3D cannot be used here: {error}") from error
    return open3d
