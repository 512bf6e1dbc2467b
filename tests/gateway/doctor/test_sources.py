from dataclasses import replace

import pytest

from gateway.doctor.evidence import Failure, Heard, PublisherLook, Trouble
from gateway.doctor.finding import Finding, Severity
from gateway.doctor.sensors import check_sensors
from schemas import codec
from tests.gateway.doctor.seeing import IMAGE, INFO, TF, evidence, heard, image, info, links, publisher, stream


def sender(node: str, type_name: str, *messages: codec.Message) -> PublisherLook:
    return replace(publisher(type_name, replace(heard(), messages=messages)), node=node)


def said(name: str, type_name: str, *publishers: PublisherLook) -> list[Finding]:
    """Return what is said of a topic besides that each publisher sends."""
    found = check_sensors(evidence(stream(name, "/topic", type_name, *publishers)))
    return [each for each in found if each.severity is not Severity.OK]


@pytest.mark.parametrize(
    ("name", "type_name", "one", "other", "how"),
    [
        ("front/color", IMAGE, image(), image(frame_id="rear"), "/a sends frame 'lens'; /b sends frame 'rear'"),
        ("front/depth", IMAGE, image(), image(width=4), "/a sends 8x4 pixels; /b sends 4x4 pixels"),
        ("front/info", INFO, info(), info(frame_id="rear"), "/a sends frame 'lens'; /b sends frame 'rear'"),
        ("front/info", INFO, info(), info(f=7.0), "/a sends the calibration of a lens of 6.0 pixels' focal length"),
    ],
)
def test_two_sensors_on_one_topic(
    name: str, type_name: str, one: codec.Message, other: codec.Message, how: str
) -> None:
    (finding,) = said(name, type_name, sender("/a", type_name, one), sender("/b", type_name, other))
    assert finding.severity is Severity.PROBLEM
    assert finding.what.startswith(f"it mixes several sensors: {how}")


def test_a_bag_that_plays_two_sensors_on_one_topic() -> None:
    (finding,) = said("front/color", IMAGE, sender("/play", IMAGE, image(), image(frame_id="rear")))
    assert finding.what.endswith("/play sends frame 'lens' and frame 'rear'")


def test_a_lens_that_focuses_or_zooms_is_one_sensor() -> None:
    assert said("front/info", INFO, sender("/a", INFO, info(f=600.0), info(f=600.3), info(f=900.0))) == []


def test_two_nodes_that_send_of_one_lens_while_it_focuses() -> None:
    one, other = sender("/a", INFO, info(f=600.0), info(f=600.3)), sender("/b", INFO, info(f=600.6))
    (finding,) = said("front/info", INFO, one, other)
    assert (finding.severity, finding.what[:13]) == (Severity.NOTE, "/a and /b all")


def test_two_lenses_of_which_one_zooms() -> None:
    one, other = sender("/a", INFO, info(f=600.0), info(f=700.0)), sender("/b", INFO, info(f=800.0))
    (finding,) = said("front/info", INFO, one, other)
    assert finding.severity is Severity.PROBLEM
    assert "/a sends the calibration of a lens of 600.0 to 700.0 pixels' focal length; /b" in finding.what


def test_two_nodes_that_send_alike() -> None:
    (finding,) = said("front/color", IMAGE, sender("/a", IMAGE, image()), sender("/b", IMAGE, image(frame_id="/lens")))
    assert finding.severity is Severity.NOTE
    assert finding.what == "/a and /b all publish it: each frame may come several times"


def test_a_node_that_is_not_heard_mixes_nothing() -> None:
    dead = PublisherLook("/b", Trouble(Failure.DEAD, "robot", 1))
    silent = replace(publisher(IMAGE, Heard(), latching=True), node="/c")
    found = said("front/color", IMAGE, sender("/a", IMAGE, image()), dead, silent)
    assert not [each for each in found if "publish it" in each.what or "mixes" in each.what]


def test_transforms_have_many_publishers() -> None:
    nodes = (sender(node, TF, links((node, "x"))) for node in ("/a", "/b"))
    assert said("tf", TF, *nodes) == []
