import pytest

from bus.keys import matches
from fleetsight import SettingsError
from fleetsight.patterns import chunk, one_camera
from schemas.keys import CameraKey


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [("*", "*"), ("**", "*"), ("r1", "r1"), ("r*", "r$*"), ("*-left", "$*-left"), ("a**b*", "a$*b$*")],
)
def test_a_pattern_is_a_chunk_of_a_key_expression(pattern: str, expected: str) -> None:
    assert chunk("robot", pattern) == expected


@pytest.mark.parametrize(("name", "meant"), [("r1", 1), ("r", 1), ("r-1.a", 1), ("R1", 0), ("xr1", 0), ("1r", 0)])
def test_a_star_stands_for_any_number_of_characters(name: str, meant: int) -> None:
    assert matches(f"fleet/{chunk('robot', 'r*')}/*/classes", f"fleet/{name}/front/classes") == meant


@pytest.mark.parametrize("pattern", ["", "r/1", "r?", "r$*", "ä", "r" * 65, "r1\n"])
def test_what_no_name_can_be_is_refused(pattern: str) -> None:
    with pytest.raises(SettingsError, match=r"robot pattern .*: no such name can be; use 1 to 64 letters"):
        chunk("robot", pattern)


def test_one_camera_is_named_in_full() -> None:
    assert one_camera("r1", "front") == CameraKey("r1", "front")
    with pytest.raises(SettingsError, match=r"^r\*/front: robot name 'r\*'"):
        one_camera("r*", "front")
    with pytest.raises(SettingsError, match="'tf' is reserved"):
        one_camera("r1", "tf")


@pytest.mark.parametrize("name", [None, 3, b"r1"])
def test_what_is_no_text_is_no_name(name: str) -> None:
    with pytest.raises(SettingsError, match=f"^robot pattern {name!r}: not text; pass a str"):
        chunk("robot", name)
    with pytest.raises(SettingsError, match=f"^robot name {name!r}: not text"):
        one_camera(name, "front")
    with pytest.raises(SettingsError, match=f"^camera name {name!r}: not text"):
        one_camera("r1", name)
