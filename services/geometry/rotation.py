"""Converts rotations between quaternions (x, y, z, w) and matrices; level directions."""

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

_ALMOST_ONE = 0.9995


def matrix_of(translation: Numbers, quaternion: Numbers) -> Numbers:
    """Return the 4 x 4 transform of a translation and a unit quaternion."""
    x, y, z, w = quaternion
    made = np.identity(4)
    made[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    made[:3, 3] = translation
    return made


def quaternion_of(matrix: Numbers) -> Numbers:
    """Return the unit quaternion of a rotation matrix, w not negative (Bar-Itzhack 2000, for an exact rotation)."""
    m = matrix[:3, :3]
    found = np.empty(4)
    trace = np.trace(m)
    largest = int(np.argmax([m[0, 0], m[1, 1], m[2, 2], trace]))
    if largest == 3:
        found[:] = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + trace)
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        found[[i, j, k, 3]] = (1 + 2 * m[i, i] - trace, m[i, j] + m[j, i], m[i, k] + m[k, i], m[k, j] - m[j, k])
    return np.asarray(found * (np.copysign(1, found[3]) / np.linalg.norm(found)))


def inverse_of(transform: Numbers) -> Numbers:
    """Return the inverse of a 4 x 4 rigid transform."""
    made = np.identity(4)
    made[:3, :3] = transform[:3, :3].T
    made[:3, 3] = -made[:3, :3] @ transform[:3, 3]
    return made


def moved(transform: Numbers, points: NDArray[np.floating]) -> Numbers:
    """Return points (n, 3) moved by a 4 x 4 transform."""
    return points @ transform[:3, :3].T + transform[:3, 3]


def slerp(start: Numbers, end: Numbers, share: float) -> Numbers:
    """Return the interpolation of two unit quaternions at a share, 0 to 1, of the shorter way (Shoemake 1985)."""
    cosine = float(start @ end)
    if cosine < 0:
        end, cosine = -end, -cosine
    if cosine > _ALMOST_ONE:
        between = start + share * (end - start)
        return np.asarray(between / np.linalg.norm(between))
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle))


def level_directions(count: int) -> Numbers:
    """Return the unit vectors (count, 2) of evenly spaced level directions, counter-clockwise from x."""
    turns = np.arange(count) * (2 * np.pi / count)
    return np.stack([np.cos(turns), np.sin(turns)], axis=1)
