"""The words of alerts: one function for each thing that a rule may report. Pure."""

from schemas.keys import CameraKey


def appeared(name: str, camera: CameraKey) -> str:
    return f"{name} appeared in view of {camera}"


def disappeared(name: str, camera: CameraKey) -> str:
    return f"{name} disappeared from view of {camera}"


def over(name: str, camera: CameraKey, count: int, limit: int) -> str:
    return f"{count} {name} in view of {camera}, over {limit}"


def under(name: str, camera: CameraKey, count: int, limit: int) -> str:
    return f"{count} {name} in view of {camera}, under {limit}"


def nearer(name: str, camera: CameraKey, distance_m: float, limit_m: float) -> str:
    return f"{name} {distance_m:.2f} m from {camera}, nearer than {limit_m:g} m"


def disagree(name: str, camera: CameraKey, counts: tuple[int, int]) -> str:
    """Return the words for two models that look at one camera. counts: what each of them has in view."""
    return f"two models count {counts[0]} and {counts[1]} {name} in view of {camera}"


def silent(camera: CameraKey) -> str:
    """Return the words for a camera that no worker reports on."""
    return f"{camera} is silent"


def offline(robot: str) -> str:
    """Return the words for a robot whose gateway is gone."""
    return f"{robot} is offline"
