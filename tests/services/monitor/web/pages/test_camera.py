from services.monitor.inventory.sighting import Sighting
from services.monitor.web.pages.camera import counted_in, otherwise, rows
from tests.services.monitor.inventory.seeing import FRONT, S, seen

NOW = 1_000 * S


def sighting(name: str = "box", nearest_m: float | None = 2.0) -> Sighting:
    return Sighting(FRONT, name, 2, 0.875, NOW - 5 * S, NOW, NOW, "m", "w", nearest_m)


def test_what_is_in_view_is_grey_when_it_is_not_of_now() -> None:
    assert "fs-stale" not in rows([sighting()], NOW, available=True)
    assert "fs-stale" in rows([sighting()], NOW, available=False)
    told = rows([sighting()], NOW, available=True)
    assert all(each in told for each in ("2.00 m", "88% sure, appeared 5 s ago", ">2<", ">box<"))
    assert " m<" not in rows([sighting(nearest_m=None)], NOW, available=True)


def test_nothing_is_told_from_what_is_not_known() -> None:
    assert "Nothing" in rows([], NOW, available=True)
    assert "Unknown" in rows([], NOW, available=False)


def test_what_was_counted_in_a_frame_is_told_and_what_is_not_known_is_not_nothing() -> None:
    told = counted_in(seen(7, {"box": 2, "<img src=x>": 1}))
    assert "<b>2</b>box" in told
    assert "<img" not in told
    assert "Nothing" in counted_in(seen(8, {}))
    assert "Unknown" in counted_in(None)


def test_names_are_text() -> None:
    assert "<img" not in rows([sighting("<img src=x>")], NOW, available=True)


def test_what_another_model_counts_differently_is_named() -> None:
    assert otherwise({}) == ""
    assert otherwise({"pallet": (1, 0), "box": (1, 3)}) == "Another model counts 3 box, 0 pallet"
