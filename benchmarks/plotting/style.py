"""How pictures look: the same bytes whenever they are drawn from the same figures, legible on light and dark pages."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.plotting.figures import Bar

OURS: Final = "#1f6feb"
OTHERS: Final = "#8c959f"
INK: Final = "#24292f"
PAPER: Final = "#ffffff"
LIMIT: Final = "#bc4c00"
ROW_INCHES: Final = 0.34
WIDTH_INCHES: Final = 8.0

STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",  # text as text: small, and searched and read aloud as such
    "svg.hashsalt": "fleetsight",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "sans-serif"],
    "font.size": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": OTHERS,
    "axes.facecolor": PAPER,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "figure.facecolor": PAPER,
    "xtick.color": INK,
    "ytick.color": INK,
}

Row = tuple[str, Bar, str]
"""What a bar is of, the figure, and its colour."""


@contextmanager
def picture(title: str, source: str, rows: int, panels: int = 1) -> Iterator[tuple[Figure, list[Axes]]]:
    """Make a picture with panels side by side, each with room for so many rows."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_INCHES, 1.2 + ROW_INCHES * rows), layout="constrained")
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
        axes = list(figure.subplots(1, panels, squeeze=False)[0])
        for each in axes:
            each.set_ylim(rows - 0.5, -0.5)
            each.tick_params(axis="y", length=0)
        yield figure, axes
        figure.supxlabel(source, x=0.01, ha="left", fontsize=7)


def bars(axes: Axes, title: str, rows: Sequence[Row], form: str, limits: Sequence[float | None] = ()) -> None:
    """Draw bars from the top down, each with its value, a line from its least to its greatest, and its limit."""
    values = [bar.value for _, bar, _ in rows]
    axes.barh(range(len(rows)), values, 0.62, color=[color for *_, color in rows])
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.set_title(title)
    axes.margins(x=0.22)
    for place, (_, bar, _) in enumerate(rows):
        if bar.least < bar.greatest:
            axes.plot([bar.least, bar.greatest], [place, place], color=INK, linewidth=0.8, marker="|", markersize=5)
        aimed = [limit for limit in limits[place : place + 1] if limit is not None]
        text = ", limit ".join(form.format(value) for value in (bar.value, *aimed))
        _label(axes, text, max([bar.greatest, *aimed]), place)
        axes.scatter(aimed, [place] * len(aimed), marker="|", s=230, linewidths=2, color=LIMIT, zorder=3)
    if limits:
        axes.margins(x=0.6)


def ranges(axes: Axes, title: str, rows: Sequence[Row], form: str) -> None:
    """Draw lines from a value to the greatest on a scale of powers of ten, with both."""
    for place, (_, bar, color) in enumerate(rows):
        axes.plot([bar.value, bar.greatest], [place, place], color=color, linewidth=5, solid_capstyle="butt")
        axes.plot([bar.value], [place], color=color, marker="o", markersize=9)
        _label(axes, form.format(bar.value), bar.value, place, left=True)
        _label(axes, form.format(bar.greatest), bar.greatest, place)
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.set_title(title)
    axes.margins(x=0.15)
    axes.xaxis.set_major_formatter(form.format)
    axes.xaxis.set_minor_formatter("")


def _label(axes: Axes, text: str, x: float, place: int, *, left: bool = False) -> None:
    offset, side = ((-7, 0), "right") if left else ((4, 0), "left")
    axes.annotate(text, (x, place), offset, textcoords="offset points", ha=side, va="center", fontsize=8)


def svg(figure: Figure) -> bytes:
    """Return a picture as SVG; nothing in it is of when it was drawn."""
    with mpl.rc_context(STYLE):
        written = BytesIO()
        figure.savefig(written, format="svg", metadata={"Date": None, "Creator": None})
    return b"\n".join(line.rstrip() for line in written.getvalue().splitlines()) + b"\n"
