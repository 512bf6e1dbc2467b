import pytest

from gateway.doctor.frames import connected

LINKS = [("base", "color"), ("base", "/mount"), ("mount", "depth"), ("map", "odom")]


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("color", "depth", True),
        ("depth", "color", True),
        ("/color", "depth", True),
        ("base", "base", True),
        ("unheard", "unheard", True),
        ("color", "odom", False),
        ("color", "unheard", False),
    ],
)
def test_frames_hang_together_through_any_number_of_transforms(one: str, other: str, *, expected: bool) -> None:
    assert connected(LINKS, one, other) is expected


def test_a_loop_ends() -> None:
    assert not connected([("a", "b"), ("b", "c"), ("c", "a")], "a", "z")
