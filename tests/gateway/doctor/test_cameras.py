from dataclasses import replace

import msgspec
import pytest

from gateway.doctor.cameras import check_cameras
from gateway.doctor.depth_alignment import placement
from gateway.doctor.evidence import Failure, Heard, MasterLook, StreamLook, Trouble
from gateway.doctor.finding import Finding, Severity, Stage
from schemas.transforms import Transforms
from services.simulator.world import Camera
from tests.gateway.doctor import views
from tests.gateway.doctor.seeing import (
    IMAGE,
    MS,
    NOW_NS,
    TF,
    color,
    color_info,
    depth,
    depth_info,
    evidence,
    heard,
    image,
    links,
    publisher,
    sends,
    stream,
)


def said(*streams: StreamLook, **transforms: Transforms | None) -> list[Finding]:
    """Return what is said of depth; transforms: by stream, what is heard beside the cameras."""
    beside = tuple(sends(name, f"/{name}", TF, message) for name, message in transforms.items() if message)
    found = [each for each in check_cameras(evidence(*streams, beside=beside)) if each.subject == "front/depth"]
    assert {each.stage for each in found} <= {Stage.CAMERAS}
    return found


def test_registered_depth() -> None:
    (finding,) = said(color(), depth(), color_info(), depth_info())
    assert (finding.severity, finding.what) == (
        Severity.OK,
        "registered to colour by camera infos, sizes and frames; whether its edges lie on colour's is not clear here",
    )


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"width": 4, "height": 2}, "colour has 8x4 pixels, depth 4x2"),
        ({"height": 5}, "colour has 8x4 pixels, depth 8x5"),
        ({"frame_id": "other"}, "colour is in frame 'lens', depth in 'other'"),
    ],
)
def test_depth_that_is_not_aligned_though_camera_infos_say_so(changes: dict[str, object], what: str) -> None:
    finding = said(color(), depth(**changes), color_info(), depth_info())[-1]
    assert finding.severity is Severity.PROBLEM
    assert finding.what == f"not aligned with colour though their camera infos say so: {what}"


@pytest.mark.parametrize(
    ("info", "what"),
    [
        ({"f": 7.0}, "camera infos with other lenses (focal lengths 6.0 and 7.0 pixels)"),
        ({"width": 4, "height": 2, "f": 6.0}, "camera infos of 8x4 and 4x2 pixels"),
        ({"frame_id": "other"}, "camera infos in frames 'lens' and 'other'"),
    ],
)
def test_depth_whose_calibration_is_another_has_to_be_registered(info: dict[str, object], what: str) -> None:
    finding = said(color(), depth(), color_info(), depth_info(**info))[-1]
    assert finding.severity is Severity.NOTE
    assert finding.what.startswith(f"not registered to colour ({what})")


@pytest.mark.parametrize(("f", "depth_f"), [(0.0, 6.0), (6.0, 0.0), (0.0, 0.0)])
def test_a_camera_info_of_no_calibration_says_nothing_of_how_depth_lies(f: float, depth_f: float) -> None:
    finding = said(color(), depth(), color_info(f=f), depth_info(f=depth_f))[-1]
    assert finding.severity is Severity.NOTE
    assert "without both camera infos it is unknown whether they are aligned" in finding.what


def test_a_thousandth_of_a_pixel_makes_no_other_lens() -> None:
    (finding,) = said(color(), depth(), color_info(f=6.0), depth_info(f=6.0009))
    assert finding.severity is Severity.OK


OTHER = {"frame_id": "ir", "width": 4, "height": 2}


@pytest.mark.parametrize(
    "transforms",
    [
        {"tf_static": links(("base", "lens"), ("base", "ir"))},
        {"tf": links(("base", "lens"), ("base", "ir"))},
        {"tf": links(("base", "lens")), "tf_static": links(("base", "ir"))},
    ],
)
def test_frames_that_transforms_connect(transforms: dict[str, Transforms]) -> None:
    finding = said(color(), depth(**OTHER), color_info(), depth_info(**OTHER), **transforms)[-1]
    assert finding.severity is Severity.NOTE
    assert "from the calibrations and transforms" in finding.what


@pytest.mark.parametrize("tf_static", [None, links(("base", "lens"), ("map", "ir"))])
def test_frames_that_nothing_connects(tf_static: Transforms | None) -> None:
    finding = said(color(), depth(**OTHER), color_info(), depth_info(**OTHER), tf_static=tf_static)[-1]
    assert finding.severity is Severity.PROBLEM
    assert "tf_static does not connect 'lens' and 'ir'" in finding.what


@pytest.mark.parametrize("said_first", [Heard(), heard(links(("odom", "base")))], ids=["nothing", "others"])
def test_frames_that_transforms_may_connect_which_were_not_heard(said_first: Heard) -> None:
    moving = stream("tf", "/tf", TF, publisher(TF, said_first))
    found = check_cameras(evidence(color(), depth(**OTHER), color_info(), depth_info(**OTHER), beside=(moving,)))
    (finding,) = (each for each in found if each.subject == "front/depth" and "connect" in each.what)
    assert finding.severity is Severity.NOTE
    assert "neither tf_static nor the first messages of tf connect 'lens' and 'ir'" in finding.what


def test_transforms_that_nobody_publishes_connect_nothing() -> None:
    unpublished = stream("tf", "/tf", "")
    found = check_cameras(evidence(color(), depth(**OTHER), color_info(), depth_info(**OTHER), unpublished))
    assert "tf_static does not connect 'lens' and 'ir'" in [each.what for each in found if each.advice][-1]


def test_frames_that_several_publishers_of_static_transforms_connect() -> None:
    publishers = [publisher(TF, heard(links(link))) for link in (("base", "lens"), ("base", "ir"))]
    tf_static = stream("tf_static", "/tf_static", TF, *publishers)
    found = check_cameras(evidence(color(), depth(**OTHER), color_info(), depth_info(**OTHER), tf_static))
    assert Severity.PROBLEM not in {each.severity for each in found}


def test_without_calibrations_only_sizes_and_frames_are_known() -> None:
    (finding,) = said(color(), depth())
    assert finding.severity is Severity.NOTE
    assert "it is unknown whether they are aligned" in finding.what
    (finding,) = said(color(), depth(width=4))
    assert finding.what.startswith("not registered to colour (colour has 8x4 pixels, depth 4x4)")


def at(first_ms: int, name: str, count: int = 5) -> StreamLook:
    """Return a stream at 10 Hz."""
    message = image(encoding="16UC1") if name == "depth" else image()
    return stream(
        f"front/{name}",
        f"/front/{name}/image_raw",
        IMAGE,
        publisher(IMAGE, heard(message, first_ms=first_ms, count=count)),
    )


@pytest.mark.parametrize(("first_ms", "said_so"), [(0, False), (450, False), (451, True), (-451, True), (90_000, True)])
def test_stamps_that_never_meet(first_ms: int, *, said_so: bool) -> None:
    """Colour's last stamp is 400 ms after its first; half a frame is 50 ms."""
    found = [each for each in said(at(0, "color"), at(first_ms, "depth")) if "stamps" in each.what]
    assert len(found) == said_so
    assert all(each.severity is Severity.PROBLEM for each in found)


def test_one_stamp_has_no_period() -> None:
    found = said(at(0, "color"), at(90_000, "depth", count=1))
    assert not [each for each in found if "stamps" in each.what]


def test_without_a_master_nothing_is_said_of_cameras() -> None:
    nothing = replace(
        evidence(color(), depth()), master=MasterLook("http://robot:11311", Trouble(Failure.DEAD, "robot", 11311))
    )
    assert not list(check_cameras(nothing))


def pair(camera: Camera, apart_ms: int = 0) -> tuple[StreamLook, StreamLook]:
    """Return a camera's two streams in the simulated warehouse, depth stamped so much later."""
    place = next(n for n in range(views.PLACES) if placement(views.color(n), views.frame(views.depth(n), "16UC1")))
    looks = []
    for name, seen, late_ms in (
        ("color", views.color(place), 0),
        ("depth", views.frame(views.depth(place, camera), "16UC1"), apart_ms),
    ):
        stamped = msgspec.structs.replace(seen.header, stamp_ns=NOW_NS + late_ms * MS)
        said_by = publisher(IMAGE, heard(msgspec.structs.replace(seen, header=stamped)))
        looks.append(stream(f"front/{name}", f"/front/{name}", IMAGE, said_by))
    return looks[0], looks[1]


INFOS = (color_info(width=320, height=240), depth_info(width=320, height=240))
WIDER = Camera(320, 240, 195, 195, 159.5, 119.5)


def test_edges_tell_that_depth_is_aligned() -> None:
    (finding,) = said(*pair(views.ALIGNED), *INFOS)
    assert finding.severity is Severity.OK
    assert finding.what.endswith("and its edges lie on colour's")
    (finding,) = said(*pair(views.ALIGNED))
    assert finding.what == "sizes and frames are those of colour, and so are its edges"


def test_edges_tell_that_depth_is_not_aligned_though_camera_infos_say_so() -> None:
    (finding,) = said(*pair(WIDER), *INFOS)
    assert finding.severity is Severity.PROBLEM
    assert finding.what.startswith(
        "not aligned with colour though their camera infos say so: the edges in both fit when depth is scaled by 1."
    )
    (finding,) = said(*pair(WIDER))
    assert finding.what.startswith("not aligned with colour: the edges in both fit when depth is scaled by 1.")


@pytest.mark.parametrize(("apart_ms", "severity"), [(20, Severity.PROBLEM), (21, Severity.OK)])
def test_images_of_two_instants_are_not_compared(apart_ms: int, severity: Severity) -> None:
    (finding,) = said(*pair(WIDER, apart_ms), *INFOS)
    assert finding.severity is severity
