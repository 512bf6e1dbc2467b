"""PLY and PCD files as their formats define them, read without the code that writes them."""

import struct

Rows = list[tuple[float, ...]]

PLY_TYPES = {"float": "f", "uchar": "B", "int": "i"}
PCD_TYPES = {("F", "4"): "f", ("U", "4"): "I"}


def read_ply(data: bytes) -> tuple[list[str], Rows]:
    """Return the names of the vertices' properties, and the vertices."""
    head, _, body = data.partition(b"end_header\n")
    first, kind, *lines = head.decode("ascii").splitlines()
    assert (first, kind) == ("ply", "format binary_little_endian 1.0")
    words = [line.split() for line in lines if not line.startswith("comment")]
    assert words[0][:2] == ["element", "vertex"]
    layout = "<" + "".join(PLY_TYPES[word[1]] for word in words[1:])
    rows = list(struct.iter_unpack(layout, body))
    assert len(rows) == int(words[0][2])
    return [word[2] for word in words[1:]], rows


def read_pcd(data: bytes) -> tuple[list[str], Rows]:
    """Return the names of the fields, and the points."""
    head, _, body = data.partition(b"DATA binary\n")
    words = [line.split() for line in head.decode("ascii").splitlines() if not line.startswith("#")]
    known = {word[0]: word[1:] for word in words}
    assert (known["VERSION"], known["HEIGHT"], set(known["COUNT"])) == (["0.7"], ["1"], {"1"})
    layout = "<" + "".join(PCD_TYPES[each] for each in zip(known["TYPE"], known["SIZE"], strict=True))
    rows = list(struct.iter_unpack(layout, body))
    assert known["WIDTH"] == known["POINTS"] == [str(len(rows))]
    return known["FIELDS"], rows
