"""The texts of alerts: one function per kind of condition. Pure."""

from schemas.keys import CameraKey


def appeared_text(name: str, camera: CameraKey) -> str:
    return f"{name} appeared in view of {camera}"


def disappeared_text(name: str, camera: CameraKey) -> str:
    return f"{name} disappeared from view of {camera}"


def over_text(name: str, camera: CameraKey, count: int, limit: int) -> str:
    return f"{count} {name} in view of {camera}, over {limit}"


def under_text(name: str, camera: CameraKey, count: int, limit: int) -> str:
    return f"{count} {name} in view of {camera}, under {limit}"


def nearer_text(name: str, camera: CameraKey, distance_m: float, limit_m: float) -> str:
    return f"{name} {distance_m:.2f} m from {camera}, nearer than {limit_m:g} m"


def disagree_text(name: str, camera: CameraKey, counts: tuple[int, int]) -> str:
    """Return the text for two models that disagree on one camera. counts: the count of each of them."""
    return f"two models count {counts[0]} and {counts[1]} {name} in view of {camera}"


def silent_text(camera: CameraKey) -> str:
    """Return the text for a camera without class lists."""
    return f"{camera} is silent"


def offline_text(robot: str) -> str:
    """Return the text for a robot whose gateway is gone."""
    return f"{robot} is offline"
