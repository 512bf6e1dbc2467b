import struct

import msgspec

from services.toolbox.clouds.files import pcd, ply
from tests.schemas.results import cloud, clouds
from tests.services.toolbox.clouds.reading import read_pcd, read_ply

SEEN = clouds(
    cloud((0.5, 0.25, 2.0), (0.25, 0.5, 2.0), rgb=bytes([1, 2, 3, 4, 5, 6]), label=2, index=4),
    cloud((1.0, 2.0, 3.0), label=2**32 - 1, index=0),
)


def test_a_ply_file_has_every_point_with_its_colour_class_and_object() -> None:
    names, rows = read_ply(ply(SEEN))
    assert names == ["x", "y", "z", "red", "green", "blue", "label", "instance"]
    assert rows == [
        (0.5, 0.25, 2.0, 1, 2, 3, 2, 4),
        (0.25, 0.5, 2.0, 4, 5, 6, 2, 4),
        (1.0, 2.0, 3.0, 255, 255, 255, -1, 0),
    ]


def test_a_pcd_file_has_the_same_with_colours_packed() -> None:
    names, rows = read_pcd(pcd(SEEN))
    assert names == ["x", "y", "z", "rgb", "label", "instance"]
    assert [(*row[:3], *row[4:]) for row in rows] == [
        (0.5, 0.25, 2.0, 2, 4),
        (0.25, 0.5, 2.0, 2, 4),
        (1.0, 2.0, 3.0, 2**32 - 1, 0),
    ]
    packed = [struct.unpack("<I", struct.pack("<f", row[3]))[0] for row in rows]
    assert [hex(rgb) for rgb in packed] == ["0x10203", "0x40506", "0xffffff"]


def test_nothing_in_view_is_a_file_without_points() -> None:
    assert read_ply(ply(clouds()))[1] == read_pcd(pcd(clouds()))[1] == []


def test_a_frames_name_breaks_no_header() -> None:
    odd = msgspec.structs.replace(SEEN.header, frame_id="läns\nend_header\n")
    assert len(read_ply(ply(msgspec.structs.replace(SEEN, header=odd)))[1]) == 3
