"""The words of alerts. Pure."""

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
    """Return the text for two models that disagree on one camera. counts: the count of each of them."""
    return f"two models count {counts[0]} and {counts[1]} {name} in view of {camera}"


def silent(camera: CameraKey) -> str:
    """Return the text for a camera without class lists."""
    return f"{camera} is silent"


def offline(robot: str) -> str:
    """Return the text for a robot whose gateway is gone."""
    return f"{robot} is offline"


def place(site: str, zone: str = "") -> str:
    """Return the name of a zone, or of a whole site."""
    return f"{site}/{zone}" if zone else site


def count_in_place(name: str, where: str, count: int, limit: int, *, over: bool) -> str:
    return f"{count} {name} in {where}, {'over' if over else 'under'} {limit}"


def passed(name: str, object_id: str, where: str, verb: str) -> str:
    """Return the text for an object that came or went. verb: entered, left, moved in."""
    return f"{name} {object_id} {verb} {where}"


def missing(name: str, object_id: str, where: str, now_at: tuple[float, float] | None) -> str:
    """Return the text for an object that is not where it belongs. now_at: in metres; None where it is gone."""
    now = "gone" if now_at is None else f"at {now_at[0]:.1f}, {now_at[1]:.1f} m"
    return f"{name} {object_id} is missing from {where}: it is {now}"


def near_robot(name: str, object_id: str, robot: str, distance_m: float, limit_m: float) -> str:
    return f"{name} {object_id} is {distance_m:.2f} m from {robot}, nearer than {limit_m:g} m"


def unseen(where: str, share: float, within_s: float) -> str:
    """Return the text for a zone that nobody looks at. share: of its floor, of which there were looks."""
    return f"{share:.0%} of {where} was looked at during the last {within_s:g} s"
