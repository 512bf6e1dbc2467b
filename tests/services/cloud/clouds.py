"""PointCloud messages for tests, in any layout."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.points import PointCloud, PointField
from tests.schemas.frames import header

CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


@dataclass(frozen=True)
class Layout:
    """fields: name and numpy type in the order they lie in, `gaps` bytes before each of them."""

    fields: Sequence[tuple[str, str]] = (("x", "f4"), ("y", "f4"), ("z", "f4"))
    gaps: Sequence[int] = ()
    is_bigendian: bool = False
    row_padding: int = 0
    tail: int = 0

    def dtype(self) -> np.dtype[Any]:
        order = ">" if self.is_bigendian else "<"
        gaps = [*self.gaps, *([0] * len(self.fields))]
        offsets, at = [], 0
        for (_, kind), gap in zip(self.fields, gaps, strict=False):
            offsets.append(at + gap)
            at = offsets[-1] + np.dtype(kind).itemsize
        return np.dtype(
            {
                "names": [name for name, _ in self.fields],
                "formats": [order + kind for _, kind in self.fields],
                "offsets": offsets,
                "itemsize": at + self.tail,
            }
        )


def packed(rgb: NDArray[np.uint8], kind: str = "f4") -> NDArray[Any]:
    """Return colours as PCL packs them, 0xAARRGGBB called a float32 or as the uint32 it is."""
    wide = rgb.astype(np.uint32)
    return (0x7F000000 | wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2]).astype(np.uint32).view(kind)


def cloud_of(values: Mapping[str, NDArray[Any]], layout: Layout, **changes: Any) -> PointCloud:
    """Lay (height, width) values out as a sensor would; what is between them is garbage."""
    dtype = layout.dtype()
    height, width = next(iter(values.values())).shape
    row_step = width * dtype.itemsize + layout.row_padding
    data = np.full(height * row_step, 0xA5, np.uint8)
    points = np.ndarray((height, width), dtype, data, strides=(row_step, dtype.itemsize))
    for name in dtype.names or ():
        points[name] = values[name]
    fields = [
        PointField(name, dtype.fields[name][1], CODES[dtype.fields[name][0].str[1:]])  # type: ignore[index]
        for name in dtype.names or ()
    ]
    whole: dict[str, Any] = {
        "header": header(),
        "height": height,
        "width": width,
        "fields": fields,
        "is_bigendian": layout.is_bigendian,
        "point_step": dtype.itemsize,
        "row_step": row_step,
        "data": data.data,
        "is_dense": False,
    }
    return PointCloud(**{**whole, **changes})


def xyz_cloud(xyz: NDArray[Any], rgb: NDArray[np.uint8] | None = None, **changes: Any) -> PointCloud:
    """Lay (height, width, 3) points out as most drivers do: 16 bytes each, with rgb in the last four."""
    values = {axis: xyz[..., at] for at, axis in enumerate("xyz")}
    fields = [(axis, "f4") for axis in "xyz"]
    if rgb is not None:
        values["rgb"] = packed(rgb)
        fields.append(("rgb", "f4"))
    return cloud_of(values, Layout(fields), **changes)
