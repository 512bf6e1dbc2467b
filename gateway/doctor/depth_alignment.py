"""Estimates how depth lies on colour from the edges that objects have in both. Pure, numpy alone.

The edges of depth are laid over those of colour in all sizes and places near; where one fits far better than any other,
that is how depth lies. Many views are not so clear, and of those nothing is said.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.to_bus.shaping.scaling import pixels_of
from schemas.compression import RAW
from schemas.image import DEPTH_ENCODINGS, ImageFrame

Floats = NDArray[np.float32]

CELLS: Final = 160
"""Approximate number of cells in a row of the grid on which images are compared."""
MIN_CELLS: Final = 60
REACH: Final = 24
"""Largest searched displacement of depth, in cells."""
SCALES: Final = tuple(1.04**step for step in range(-8, 9))
NEAR: Final = (2, 5, 5)
"""Neighbourhood of the best place that counts as the same place, in steps of scale, cells down and right."""
CLEAR: Final = 1.4
"""Factor by which the best place must beat any other place."""
BETTER: Final = 1.2
"""Factor by which a place must beat the aligned one before depth counts as misaligned."""
ABOVE_NOISE: Final = 6.0
TOLERANCE: Final = (1, 3, 3)
"""Tolerance that counts as aligned, in steps of scale, cells down and right: parallax shifts near objects."""
GAP_CELLS: Final = 6
"""Widest gap without readings across which two distances are compared, in cells."""
STEP: Final = (0.05, 0.25)
"""Below the first difference of log distances neighbours are one surface, above the second surely two."""

_COLORS: Final = frozenset({"rgb8", "bgr8", "rgba8", "bgra8", "mono8"})


@dataclass(frozen=True, slots=True)
class Placement:
    """Scale about the centre and shift, right and down in pixels, that bring depth onto colour.

    aligned: as good as not at all.
    """

    scale: float
    right: int
    down: int
    aligned: bool


def placement(color: ImageFrame, depth: ImageFrame) -> Placement | None:
    """Return how depth lies on colour, or None where that is unclear or the pixels cannot be read."""
    cell = max(1, color.width // CELLS)
    if not _readable(color, depth) or min(color.width, color.height) // cell < MIN_CELLS:
        return None
    fits = _fits(_color_edges(color, cell), _depth_edges(depth, cell))
    best = [int(index) for index in np.unravel_index(int(fits.argmax()), fits.shape)]
    home = [size // 2 for size in fits.shape]
    aligned = all(abs(at - own) <= near for at, own, near in zip(best, home, TOLERANCE, strict=True))
    if not _clear(fits, best) or not (aligned or _elsewhere(fits, best, home)):
        return None
    return Placement(SCALES[best[0]], (best[2] - REACH) * cell, (best[1] - REACH) * cell, aligned)


def _readable(color: ImageFrame, depth: ImageFrame) -> bool:
    sizes = (color.width, color.height) == (depth.width, depth.height)
    plain = {color.format, depth.format} == {RAW}
    return sizes and plain and color.encoding in _COLORS and depth.encoding in DEPTH_ENCODINGS


def _around(place: Sequence[int], near: Sequence[int]) -> tuple[slice, ...]:
    return tuple(slice(max(at - reach, 0), at + reach + 1) for at, reach in zip(place, near, strict=True))


def _clear(fits: Floats, best: Sequence[int]) -> bool:
    peak = float(fits[tuple(best)])
    others = fits.copy()
    others[_around(best, NEAR)] = -1
    return peak > ABOVE_NOISE * float(fits.std()) and peak > CLEAR * float(others.max())


def _elsewhere(fits: Floats, best: Sequence[int], home: Sequence[int]) -> bool:
    """Return whether depth fits far better elsewhere than aligned, even at the rim of the search range."""
    rim = any(at in {0, size - 1} for at, size in zip(best, fits.shape, strict=True))
    return not rim and float(fits[tuple(best)]) > BETTER * float(fits[_around(home, TOLERANCE)].max())


def _fits(color: Sequence[Floats], depth: Sequence[Floats]) -> Floats:
    """Return the fraction of depth's edges that fit colour's, by scale, down and right."""
    height, width = color[0].shape
    room = (height + 2 * REACH, width + 2 * REACH)
    sharp = [edges - _blurred(edges, 6) for edges in color]
    spectra = [np.fft.rfft2(edges, room) for edges in sharp]
    energies = [np.fft.rfft2(edges * edges, room) for edges in sharp]
    found = np.zeros((len(SCALES), 2 * REACH + 1, 2 * REACH + 1), np.float32)
    for number, scale in enumerate(SCALES):
        shared, theirs, ours = np.zeros(room), np.zeros(room), 0.0
        for edges, spectrum, energy in zip(depth, spectra, energies, strict=True):
            scaled, inside = _scaled(edges, scale)
            scaled = (_blurred(scaled, 1) - _blurred(scaled, 6)) * inside
            shared += np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(scaled, room)), room)
            theirs += np.fft.irfft2(energy * np.conj(np.fft.rfft2(inside, room)), room)
            ours += float(np.square(scaled).sum())
        fit = shared / np.sqrt(np.maximum(theirs, 1e-6) * max(ours, 1e-6))
        found[number] = np.roll(fit, (REACH, REACH), (0, 1))[: 2 * REACH + 1, : 2 * REACH + 1]
    return found


def _scaled(edges: Floats, scale: float) -> tuple[Floats, Floats]:
    """Return the edges scaled about their centre, and the mask of where they are known."""
    height, width = edges.shape
    rows, columns = (np.rint((np.arange(n) - (n - 1) / 2) / scale + (n - 1) / 2).astype(int) for n in (height, width))
    inside = ((rows >= 0) & (rows < height))[:, None] & ((columns >= 0) & (columns < width))
    taken = edges[np.clip(rows, 0, height - 1)][:, np.clip(columns, 0, width - 1)]
    return taken * inside, inside.astype(np.float32)


def _blurred(values: Floats, radius: int) -> Floats:
    """Return means over squares of 2 x radius + 1 cells."""
    side = 2 * radius + 1
    sums = np.pad(values, radius, mode="edge").cumsum(0, np.float64).cumsum(1)
    sums = np.pad(sums, ((1, 0), (1, 0)))
    blurred: Floats = (sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]) / side**2
    return blurred.astype(np.float32)


def _cells(pixels: Floats, cell: int) -> Floats:
    """Return the image with the pixels of each cell on an axis of their own."""
    height, width = (size // cell for size in pixels.shape)
    cut = pixels[: height * cell, : width * cell].reshape(height, cell, width, cell)
    return cut.swapaxes(1, 2).reshape(height, width, cell * cell)


def _color_edges(color: ImageFrame, cell: int) -> tuple[Floats, Floats]:
    """Return the brightness gradient across and down, where 1 is a strong one for this image."""
    grey = np.sqrt(_cells(pixels_of(color)[..., :3].mean(2, dtype=np.float32), cell).mean(2))
    down, across = np.gradient(grey)
    much = float(np.percentile(np.hypot(across, down), 95)) + 1e-6
    return np.minimum(np.abs(across) / much, 1), np.minimum(np.abs(down) / much, 1)


def _depth_edges(depth: ImageFrame, cell: int) -> tuple[Floats, Floats]:
    """Return the depth edges across and down, from 0 for none to 1 for certain."""
    metres = pixels_of(depth)[..., 0].astype(np.float32)
    distances = _cells(np.where(np.isfinite(metres) & (metres > 0), metres, 0), cell)
    readings = (distances > 0).sum(2)
    logs = np.log(distances, out=np.zeros_like(distances), where=distances > 0).sum(2) / np.maximum(readings, 1)
    return _jumps(logs, readings > 0), _jumps(logs.T, (readings > 0).T).T


def _jumps(logs: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the difference of the nearest known values before and after each cell of a row."""
    places, last = np.arange(logs.shape[1]), logs.shape[1] - 1
    upto = np.maximum.accumulate(np.where(known, places, -1), 1)
    beyond = last - np.maximum.accumulate(np.where(known[:, ::-1], places, -1), 1)[:, ::-1]
    before = np.pad(upto[:, :-1], ((0, 0), (1, 0)), constant_values=-1)
    after = np.pad(beyond[:, 1:], ((0, 0), (0, 1)), constant_values=last + 1)
    both = (before >= 0) & (after <= last) & (after - before <= GAP_CELLS)
    values = [np.take_along_axis(logs, np.clip(each, 0, last), 1) for each in (before, after)]
    height = (np.abs(values[1] - values[0]) - STEP[0]) / (STEP[1] - STEP[0])
    return np.where(both, np.clip(height, 0, 1), 0).astype(np.float32)
