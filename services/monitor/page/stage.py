"""Where a picture or a scene is shown, and over it, while there is none, why."""

from pathlib import Path
from typing import Final

from nicegui import ui

from schemas.errors import SchemaError
from schemas.keys import CameraKey
from services.monitor.live_views.reasons import Reason
from services.monitor.page.frame import nothing_yet

VIEW_STYLE: Final = (Path(__file__).parent / "view.css").read_text(encoding="utf-8")


def camera_key(robot: str, camera: str) -> CameraKey | None:
    """Return the camera that an address names; None, and say so, if none can be called so."""
    try:
        return CameraKey(robot, camera)
    except SchemaError as error:
        nothing_yet("videocam_off", "There is no such camera", str(error))
        return None


class Stage:
    """A dark place with a reason before it. What is shown is made inside `filling`."""

    def __init__(self) -> None:
        self._stage = ui.element("div").classes("fs-stage")
        with self._stage, ui.element("div").classes("fs-reason").props('role="status"') as self._reason:
            with ui.element("strong"):
                self._title = ui.label()
            self._age = ui.label().classes("fs-age")
            self._advice = ui.label()
        self.explain(None)

    def filling(self) -> ui.element:
        """Return what that which is shown is to be made in."""
        return self._stage

    def explain(self, reason: Reason | None, age: str = "") -> None:
        """Say why nothing is shown, or nothing newer than what is so old; None: it is as it should be."""
        self._reason.set_visibility(reason is not None)
        if reason is not None:
            self._title.set_text(reason.title)
            self._advice.set_text(reason.advice)
            self._age.set_text(age)
            self._age.set_visibility(bool(age))
            self._reason.classes(**{"add" if age else "remove": "fs-below"})
