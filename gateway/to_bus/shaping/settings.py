"""Settings of rates, scaling, compression, private areas and the uplink's budget."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Annotated, Any, ClassVar, Final, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field

from gateway.to_bus.shaping.compression import Method, parse_method
from gateway.to_bus.shaping.scaling import MAX_FACTOR
from schemas.image import Area, parse_area
from schemas.keys import ROS, Stream

MOST_HZ: Final = 1_000.0
LEAST_HZ: Final = 0.001

IMAGES: Final = (Stream.COLOR, Stream.DEPTH)
FRAMES: Final = (*IMAGES, Stream.POINTS)

_FRACTION: Final = re.compile(r"1/(\d{1,2})")

V = TypeVar("V")


def _hz(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not LEAST_HZ <= value <= MOST_HZ:
        raise ValueError(f"{text!r} is not a rate; use {LEAST_HZ:g} to {MOST_HZ:g} Hz")
    return value


def _factor(text: str) -> int:
    """Return n of a scale written as 1/n or as its decimal fraction."""
    match = _FRACTION.fullmatch(text)
    try:
        inverse = float(match[1]) if match else 1 / float(text)
    except (ValueError, ZeroDivisionError):
        inverse = math.nan
    if not 1 <= inverse <= MAX_FACTOR or abs(inverse - round(inverse)) > inverse / 100:
        raise ValueError(f"{text!r} is not a scale; use 1, 1/2 (or 0.5), 1/3, 1/4 ... 1/{MAX_FACTOR}")
    return round(inverse)


def _listed(given: Any) -> Any:
    """Accept one value or a mapping from a file where the command line has a list."""
    match given:
        case Mapping():
            return [f"{pattern}={value}" for pattern, value in given.items()]
        case bool() | None:
            return given
        case str() | int() | float():
            return str(given).split(",")
        case list():
            return [str(each) for each in given]
    return given


def _rules(given: Sequence[str], parse: Callable[[str], V], streams: Sequence[str]) -> list[tuple[str, V]]:
    """Return (pattern, value) pairs; an empty pattern stands for all of `streams` of cameras."""
    found = []
    for each in given:
        pattern, _, value = each.strip().rpartition("=")
        try:
            found.append((pattern.strip(), parse(value.strip())))
        except ValueError as error:
            raise ValueError(f"{error}{f' (for {pattern})' if pattern else ''}") from error
        if "=" in each and not _fits_any(pattern.strip(), streams):
            raise ValueError(f"{pattern.strip()!r} matches no stream this applies to, like front/{', '.join(streams)}")
    return found


def _fits_any(pattern: str, streams: Sequence[str]) -> bool:
    last = pattern.rpartition("/")[2]
    return any(fnmatchcase(stream, last) for stream in streams) or (ROS in streams and pattern.startswith(f"{ROS}/"))


def _of(rules: Sequence[tuple[str, V]], name: str, otherwise: V) -> V:
    """Return the value of the last rule that matches the stream."""
    fitting = _fitting(rules, name)
    return fitting[-1] if fitting else otherwise


def _fitting(rules: Sequence[tuple[str, V]], name: str) -> list[V]:
    camera_has = name.rpartition("/")[2] in FRAMES and not name.startswith(f"{ROS}/")
    return [value for pattern, value in rules if (fnmatchcase(name, pattern) if pattern else camera_has)]


def _checked(parse: Callable[[str], Any], streams: Sequence[str]) -> AfterValidator:
    def check(given: list[str]) -> list[str]:
        _rules(given, parse, streams)
        return given

    return AfterValidator(check)


LIMITED: Final = (*FRAMES, ROS)


class ShapingSettings(BaseModel):
    """Settings of the rates, sizes and formats of streams."""

    heading: ClassVar = "rates, sizes and formats"

    max_hz: Annotated[
        list[str],
        BeforeValidator(_listed),
        _checked(_hz, LIMITED),
        Field(
            description="most frames a second: one number for cameras' images and points, or STREAM=NUMBER, like"
            " 10,*/depth=5,ros/battery=1 (* stands for anything, the last that fits counts). A camera's streams send"
            " the same instants"
        ),
    ] = []
    scale: Annotated[
        list[str],
        BeforeValidator(_listed),
        _checked(_factor, IMAGES),
        Field(description="size of images as a whole fraction, or STREAM=FRACTION, like 1/2,rear/color=1/4"),
    ] = []
    compression: Annotated[
        list[str],
        BeforeValidator(_listed),
        _checked(parse_method, FRAMES),
        Field(
            description="auto, raw, jpeg[:QUALITY], png or zstd[:LEVEL], or STREAM=one of them, like"
            " */color=jpeg:90. auto is raw while only this machine listens, else jpeg:80 for colour and zstd for the"
            " rest; what a format cannot hold without harm becomes zstd"
        ),
    ] = ["auto"]
    privacy_mask: Annotated[
        list[str],
        BeforeValidator(_listed),
        _checked(parse_area, IMAGES),
        Field(
            description="areas that are blackened in images before anything leaves the gateway, as STREAM=CORNERS, like"
            " 'front/*=0:0 1:0 1:0.2 0:0.2': each corner is ACROSS:DOWN, shares of width and height from the left and"
            " top. Several areas for one stream add up"
        ),
    ] = []
    uplink_mbit: Annotated[
        float | None,
        Field(
            ge=0.01,
            le=100_000,
            description="megabits a second for everything that leaves this machine; images, points and ros/... wait or"
            " are left out for it, at most 100 ms of it is ever queued",
        ),
    ] = None

    def unused_shaping(self, names: Collection[str]) -> Iterator[str]:
        """Yield the rules that match none of these streams, like `--max-hz fornt/color`.

        Rules for every camera's streams also apply to future cameras, so they are not yielded.
        """
        asked = {
            "--max-hz": self.max_hz,
            "--scale": self.scale,
            "--compression": self.compression,
            "--privacy-mask": self.privacy_mask,
        }
        for option, rules in asked.items():
            for pattern in (each.rpartition("=")[0].strip() for each in rules):
                if pattern and not pattern.startswith("*/") and not any(fnmatchcase(name, pattern) for name in names):
                    yield f"{option} {pattern}"

    def max_hz_of(self, name: str) -> float | None:
        """Return the limit in frames a second of a stream named like `front/depth`, or None."""
        return _of(_rules(self.max_hz, _hz, LIMITED), name, None)

    def factor_of(self, name: str) -> int:
        """Return the whole factor by which a stream's images are scaled down."""
        return _of(_rules(self.scale, _factor, IMAGES), name, 1)

    def method_of(self, name: str) -> Method:
        """Return the compression method of a stream's frames."""
        return _of(_rules(self.compression, parse_method, FRAMES), name, Method("auto"))

    def private_areas_of(self, name: str) -> tuple[Area, ...]:
        """Return the areas of a stream's images that are blackened."""
        return tuple(_fitting(_rules(self.privacy_mask, parse_area, IMAGES), name))
