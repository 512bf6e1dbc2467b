"""CVAT's form, written and read."""

from typing import Final

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from services.toolbox.labels import cvat
from services.toolbox.labels.objects import LabelsError, PictureLabels, box_of, object_of

SIZE: Final = (40, 20)
IMAGE: Final = '<image id="0" name="train/a_1.jpg" width="40" height="20">{}</image>'


def read(shapes: str, image: str = IMAGE) -> PictureLabels:
    text = f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n{image.format(shapes)}\n'
    (found,) = cvat.read(f"{text}</annotations>\n".encode(), "a.xml")
    return found


def test_shapes_as_cvat_writes_them() -> None:
    found = read(
        '\n<polygon label="a" source="manual" occluded="0" points="0.00,0.00;20.00,0.00;20.00,20.00" z_order="0">\n'
        '<attribute name="colour">red</attribute></polygon>'
        '<box label="b" source="manual" occluded="0" xtl="10.0" ytl="5.0" xbr="30.0" ybr="55.0" z_order="0"></box>'
        '<box label="c" xtl="10" ytl="5" xbr="30" ybr="15" rotation="90.0"></box>'
        '<mask label="d" source="semi-auto" rle="0, 100" left="30" top="8" width="10" height="10" z_order="0"></mask>'
    )
    assert (found.name, found.size, found.place) == ("a_1.jpg", SIZE, "a.xml, line 4")
    assert found.objects is not None
    polygon, box, turned, mask = found.objects
    assert polygon.polygon.tolist() == [[0, 0], [0.5, 0], [0.5, 1]]
    assert (box.is_box, box.polygon.tolist()) == (True, [[0.25, 0.25], [0.75, 0.25], [0.75, 1], [0.25, 1]])
    assert not turned.is_box
    assert np.sort(turned.polygon * SIZE, axis=0) == pytest.approx(np.array([(15, 0), (15, 0), (25, 20), (25, 20)]))
    assert (mask.polygon * SIZE).min(axis=0).tolist() == [30.5, 8.5]
    assert (mask.polygon * SIZE).max(axis=0).tolist() == [39.5, 17.5]


def test_a_turned_box_turns_clockwise() -> None:
    (box,) = read('<box label="c" xtl="10" ytl="10" xbr="30" ybr="10.001" rotation="30"/>').objects or ()
    left, right = (box.polygon * SIZE)[0], (box.polygon * SIZE)[1]
    assert left == pytest.approx((20 - 8.66, 5), abs=0.01)
    assert right == pytest.approx((20 + 8.66, 15), abs=0.01)


def test_another_reader_of_xml_finds_what_is_written() -> None:
    polygon = object_of("<\"&'ü>", [0, 0, 40, 0, 40, 20], SIZE, "")
    box = box_of("box", (10, 5, 20, 10), SIZE, "")
    pictures = [
        PictureLabels("ü&'\".jpg", "", (polygon, box), SIZE, by="model"),
        PictureLabels("2.jpg", "", (), (9, 9)),
    ]
    root = fromstring(cvat.write(pictures, ["box", "<\"&'ü>"]))
    assert [each.text for each in root.iterfind("meta/task/labels/label/name")] == ["box", "<\"&'ü>"]
    first, second = root.iterfind("image")
    assert first.attrib == {"id": "0", "name": "ü&'\".jpg", "width": "40", "height": "20"}
    assert [each.tag for each in first] == ["polygon", "box"]
    assert {each.get("source") for each in first} == {"auto"}
    assert first[0].get("points") == "0.000,0.000;40.000,0.000;40.000,20.000"
    assert [float(first[1].attrib[key]) for key in ("xtl", "ytl", "xbr", "ybr")] == [10, 5, 30, 15]
    assert len(second) == 0


@pytest.mark.parametrize(
    ("shapes", "reason"),
    [
        ('<polygon label="a" points="0,0;5,5"/>', "line 4: a has no area within the picture"),
        ('\n<polygon label="a" points="0,0;5;5,5"/>', "line 5: the corners are not pairs of numbers"),
        ('<polygon label="a" points="0,0;5,x;5,5"/>', "line 4: a polygon lacks an attribute, or it is no number"),
        ('<polygon label="a" points="0,0;5,nan;5,5"/>', "line 4: a coordinate is not a finite number"),
        ('<polygon points="0,0;5,0;5,5"/>', "line 4: a polygon lacks an attribute"),
        ('<box label="a" xtl="0" ytl="0" xbr="inf" ybr="1"/>', "line 4: a box is four finite numbers"),
        ('<box label="" xtl="0" ytl="0" xbr="9" ybr="9"/>', "line 4: not the name of a class"),
        (
            '<mask label="a" rle="1, 2" left="0" top="0" width="3" height="2"/>',
            "line 4: its runs do not fill a mask of 3",
        ),
        ('<mask label="a" rle="x" left="0" top="0" width="3" height="2"/>', "line 4: a mask lacks an attribute"),
        ('<mask label="a" rle="6" left="0" top="0" width="-3" height="-2"/>', "line 4: its runs do not fill a mask"),
        (f'<mask label="a" rle="0,99" left="{"9" * 400}" top="0" width="9" height="11"/>', "line 4: a mask lacks an"),
        ('<polyline label="a" points="0,0;5,5"/>', "line 4: a polyline has no area; delete it in CVAT"),
        ('<tag label="a"/>', "line 4: a tag has no area"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(shapes: str, reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        read(shapes)
    assert str(caught.value).startswith(f"a.xml, {reason}")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<annotations>\n<image", "line 2: not XML; it may have been cut off"),
        ("<rss/>", "line 1: a file of <rss>, not of CVAT's <annotations>"),
        ("", "line 1: not XML"),
        ("<annotations><track/></annotations>", "line 1: a track has no area; delete it in CVAT, or export 'CVAT for"),
        (
            '<annotations><image name="a" width="0" height="4"/></annotations>',
            "line 1: the picture is not 1 to 16384 pixels wide and high",
        ),
        (
            f'<annotations><image name="a" width="{"9" * 400}" height="4"/></annotations>',
            "line 1: the picture is not 1",
        ),
        ('<annotations><image name="" width="4" height="4"/></annotations>', "line 1: '' names no picture"),
        ('<?xml version="1.0" encoding="no-such"?><annotations/>', "line 1: not XML"),
        ("<annotations>\x00</annotations>", "line 1: not XML"),
    ],
)
def test_files_that_are_not_of_the_form(text: str, reason: str) -> None:
    with pytest.raises(LabelsError) as caught:
        list(cvat.read(text.encode(), "a.xml"))
    assert str(caught.value).startswith(f"a.xml, {reason}")


@pytest.mark.parametrize(
    "declaration",
    [
        '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;">]>',
        '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE annotations SYSTEM "http://127.0.0.1:9/a.dtd">',
    ],
)
def test_entities_are_refused(declaration: str) -> None:
    with pytest.raises(LabelsError, match=r"a\.xml: it declares a document type or entities, as CVAT never does"):
        list(cvat.read(f"{declaration}<annotations>&c;</annotations>".encode(), "a.xml"))
