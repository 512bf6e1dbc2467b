"""Regions of cameras' images that objects are looked for in."""

import pytest
from pydantic import ValidationError

from bus.fake import FakeNetwork
from schemas import codec
from schemas.detections import Box, ClassList, Detection
from schemas.image import Area, is_inside, parse_area
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects
from services.detector.regions import Regions
from services.detector.settings import DetectorSettings
from tests.schemas.frames import image
from tests.services.detector.support.told_model import ToldModel
from tests.services.detector.test_inference import CAMERAS, Rig
from tests.waiting import next_of

FRONT, REAR = CameraKey("r1", "front"), CameraKey("r1", "rear")
LEFT, RIGHT = "0:0 0.5:0 0.5:1 0:1", "0.5:0 1:0 1:1 0.5:1"


def thing(name: str, x1: float, y1: float, x2: float, y2: float) -> Detection:
    return Detection(name=name, score=0.9, box=Box(x1, y1, x2, y2))


FOUND = DetectedObjects([thing("left", 0, 0, 20, 40), thing("right", 80, 0, 100, 40), thing("both", 20, 0, 70, 40)])


def kept(regions: list[str], camera: CameraKey) -> list[str]:
    found = Regions(regions).within(camera, image(height=40, width=100), FOUND)
    return [each.name for each in found.objects]


def test_a_box_whose_centre_is_in_a_region_is_kept_and_a_camera_without_any_has_no_limits() -> None:
    assert kept([], FRONT) == ["left", "right", "both"]
    assert kept([f"r1/front={LEFT}"], FRONT) == ["left", "both"]
    assert kept([f"r1/front={LEFT}"], REAR) == ["left", "right", "both"]
    assert kept([f"*/front={RIGHT}"], FRONT) == ["right"]
    assert kept([f"r?/*={LEFT}", f"r1/front={RIGHT}"], FRONT) == ["left", "right", "both"]
    assert kept([RIGHT], REAR) == ["right"]


def test_what_else_is_known_of_the_call_stays() -> None:
    timed = DetectedObjects(FOUND.objects, {"model": 7})
    assert Regions([LEFT]).within(FRONT, image(height=40, width=100), timed).spans == {"model": 7}


async def test_lists_of_classes_are_of_the_regions_alone() -> None:
    model = ToldModel(at_once=True)
    model.objects = [thing("left", 0, 0, 1, 1), thing("right", 5, 0, 6, 1)]
    rig = Rig(model, regions=[f"r1/c0={RIGHT}"])
    async with FakeNetwork().open_bus() as bus, rig.running(bus) as lists:
        for camera in CAMERAS[:2]:
            rig.post(camera, 1)
        samples = [await next_of(lists), await next_of(lists)]
    said = [codec.decode(ClassList, each.payload, each.encoding) for each in samples]
    assert {each.header.camera: sorted(seen.name for seen in each.classes) for each in said} == {
        "c0": ["right"],
        "c1": ["left", "right"],
    }


@pytest.mark.parametrize(
    ("area", "inside", "outside"),
    [
        ("0:0 1:0 0:1", (0.2, 0.2), (0.8, 0.8)),
        ("0.1:0.1 0.9:0.1 0.9:0.9 0.1:0.9", (0.5, 0.5), (0.05, 0.5)),
        ("0:0 1:0 1:1 0.5:0.2 0:1", (0.1, 0.5), (0.5, 0.6)),
    ],
)
def test_a_point_is_inside_of_a_polygon_or_not(
    area: str, inside: tuple[float, float], outside: tuple[float, float]
) -> None:
    polygon: Area = parse_area(area)
    assert is_inside(polygon, *inside)
    assert not is_inside(polygon, *outside)
    assert is_inside(polygon[::-1], *inside)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("front=0:0 1:0 1:1", "'front' is not a camera; use ROBOT/CAMERA, like r1/front or */rear"),
        ("r1/front/color=0:0 1:0 1:1", "'r1/front/color' is not a camera"),
        ("r1/=0:0 1:0 1:1", "'r1/' is not a camera"),
        ("r1/front=0:0 1:1", "'0:0 1:1' is not an area; use 3 to 64 corners"),
        ("r1/front=0:0 2:0 1:1", "'2:0' is not a corner"),
    ],
)
def test_a_region_that_is_none_is_named(text: str, reason: str) -> None:
    with pytest.raises(ValidationError) as caught:
        DetectorSettings(connect=["tcp/127.0.0.1:7447"], regions=[text])
    assert reason in str(caught.value)
