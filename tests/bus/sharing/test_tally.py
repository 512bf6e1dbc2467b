from collections import Counter

from bus.sharing.tally import Tally
from schemas.keys import CameraKey
from schemas.status import CameraLoad


def test_what_is_added_is_named_and_forgotten_where_it_was_counted() -> None:
    tally, dropped = Tally(CameraKey("r1", "front")), Counter({"too old": 2, "never": 0})
    tally.measured = 3
    tally.add("points", dropped)
    assert not dropped
    tally.add("points", Counter({"too old": 1}))
    assert tally.load(serving=True) == CameraLoad(
        robot="r1", camera="front", inferred=3, dropped={"points: too old": 3}, serving=True
    )
