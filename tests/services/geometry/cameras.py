"""Calibrations and cameras for tests."""

from schemas.camera_info import CameraInfo, Region
from services.geometry.camera import CameraModel
from tests.schemas.frames import header

PLUMB_BOB = ("plumb_bob", [0.1, -0.2, 0.001, 0.002, 0.05])
RATIONAL = ("rational_polynomial", [0.5, 0.3, 0.001, -0.001, 0.01, 0.7, 0.2, 0.05])
PRISM = ("rational_polynomial", [0.1, 0.02, 0.001, -0.001, 0.01, 0.1, 0.0, 0.01, 0.002, -0.001, 0.001, 0.002])
EQUIDISTANT = ("equidistant", [0.1, -0.02, 0.01, -0.003])
LENSES = {"none": ("plumb_bob", []), "plumb_bob": PLUMB_BOB, "rational": RATIONAL, "prism": PRISM, "fish": EQUIDISTANT}


def info(
    *,
    height: int = 48,
    width: int = 64,
    focal: float = 50.0,
    lens: tuple[str, list[float]] = ("plumb_bob", []),
    binning: int = 0,
    roi: Region = Region(),  # noqa: B008 - frozen
) -> CameraInfo:
    cx, cy = (width - 1) / 2, (height - 1) / 2
    return CameraInfo(
        header=header(),
        height=height,
        width=width,
        distortion_model=lens[0],
        d=lens[1],
        k=[focal, 0, cx, 0, focal, cy, 0, 0, 1],
        r=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        p=[focal, 0, cx, 0, 0, focal, cy, 0, 0, 0, 1, 0],
        binning_x=binning,
        binning_y=binning,
        roi=roi,
    )


def camera(
    *, height: int = 48, width: int = 64, focal: float = 50.0, lens: tuple[str, list[float]] = ("plumb_bob", [])
) -> CameraModel:
    return CameraModel.of(info(height=height, width=width, focal=focal, lens=lens))
