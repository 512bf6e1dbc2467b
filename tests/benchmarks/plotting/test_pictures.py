import re

import pytest

from benchmarks.plotting.figures import Figures, NoFigureError
from benchmarks.plotting.pictures import PICTURES
from benchmarks.plotting.style import svg
from tests.benchmarks.plotting.kept import kept

SHOWN = {
    "gateway": ["1500", "480", "0.42", "2.90", "rospy and zenoh-python"],
    "scaling": ["18", "140", "141", "0.31, limit 0.50", "2.40, limit 3.00"],
    "space": ["0.20%", "1.20%", "3.60%", "120.00%"],
    "detector": ["30.0", "20.5", "3.2 ms"],
    "guide": ["12.00", "8.25", "1.70", "150", "901"],
    "hops": ["model", "52.25, limit 48.50", "1.50"],
}


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_shows_its_figures_and_is_the_same_each_time(name: str) -> None:
    picture = PICTURES[name]
    drawn = svg(picture.draw(Figures(kept(picture.benchmark))))
    assert drawn == svg(picture.draw(Figures(kept(picture.benchmark))))
    text = " ".join(each.decode() for each in re.findall(rb"<text[^>]*>([^<]*)</text>", drawn))
    for figure in [*SHOWN[name], "2 cores, A Processor, 2026-01-02"]:
        assert figure in text
    assert b"<dc:date>" not in drawn
    assert len(drawn) < 40_000


@pytest.mark.parametrize("name", PICTURES)
def test_what_is_missing_is_named(name: str) -> None:
    benchmark = PICTURES[name].benchmark
    with pytest.raises(NoFigureError, match=rf"^{benchmark}: \S+: no such figure"):
        PICTURES[name].draw(Figures({**kept(benchmark), "figures": {}}))
