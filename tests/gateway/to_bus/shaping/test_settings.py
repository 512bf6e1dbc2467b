from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from gateway.settings import GatewaySettings
from gateway.to_bus.shaping.settings import ShapingSettings
from services.toolbox.errors import UsageError
from services.toolbox.settings import load


def test_nothing_is_left_out_or_changed_unless_asked_for() -> None:
    settings = ShapingSettings()
    for stream in ("front/color", "front/depth", "front/points", "ros/battery", "tf"):
        assert (settings.max_hz_of(stream), settings.factor_of(stream)) == (None, 1)
        assert str(settings.method_of(stream)) == "auto"
    assert settings.uplink_mbit is None


def test_one_number_is_for_cameras_frames_and_the_last_rule_that_fits_counts() -> None:
    settings = ShapingSettings(max_hz=["10", "*/depth=5", "rear/*=2", "ros/b*=1"])
    asked = ("front/color", "front/depth", "front/points", "rear/depth", "ros/battery", "ros/color", "tf", "front/info")
    assert [settings.max_hz_of(stream) for stream in asked] == [10, 5, 10, 2, 1, None, None, None]
    assert ShapingSettings(max_hz=["rear/*=2", "10"]).max_hz_of("rear/color") == 10


@pytest.mark.parametrize(
    ("text", "factor"), [("1", 1), ("0.5", 2), ("1/2", 2), ("0.333", 3), ("1/3", 3), ("0.25", 4), ("1/16", 16)]
)
def test_scales_are_whole_fractions(text: str, factor: int) -> None:
    assert ShapingSettings(scale=[text]).factor_of("front/depth") == factor


@pytest.mark.parametrize("given", ["0.5", 0.5, ["0.5"], {"*": 0.5}, {"front/*": "1/2"}])
def test_files_may_say_it_as_they_like(given: Any) -> None:
    assert ShapingSettings.model_validate({"scale": given}).factor_of("front/color") == 2


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("max_hz", "fast", "'fast' is not a rate; use 0.001 to 1000 Hz"),
        ("max_hz", "0", "'0' is not a rate"),
        ("max_hz", "nan", "'nan' is not a rate"),
        ("max_hz", "1001", "'1001' is not a rate"),
        ("max_hz", "front/depth=-1", "'-1' is not a rate; use 0.001 to 1000 Hz (for front/depth)"),
        ("max_hz", "front=5", "'front' matches no stream this applies to, like front/color, depth, points, ros"),
        ("max_hz", "tf=5", "'tf' matches no stream"),
        ("max_hz", "front/info=5", "'front/info' matches no stream"),
        ("max_hz", "=5", "'' matches no stream"),
        ("max_hz", None, "list"),
        ("scale", "0.4", "'0.4' is not a scale; use 1, 1/2 (or 0.5), 1/3, 1/4 ... 1/16"),
        ("scale", "2", "'2' is not a scale"),
        ("scale", "0", "'0' is not a scale"),
        ("scale", "1/0", "'1/0' is not a scale"),
        ("scale", "1/17", "'1/17' is not a scale"),
        ("scale", "front/points=0.5", "'front/points' matches no stream this applies to, like front/color, depth"),
        ("compression", "gif", "'gif' is not one of auto, raw, jpeg, jpeg:QUALITY, png, zstd, zstd:LEVEL"),
        ("compression", "front/color=jpeg:0", "jpeg goes from 1 to 100 (for front/color)"),
        ("compression", "ros/map=zstd", "'ros/map' matches no stream"),
        ("uplink_mbit", 0, "greater than or equal to 0.01"),
    ],
)
def test_what_is_wrong_is_named(field: str, value: Any, reason: str) -> None:
    with pytest.raises(ValidationError) as caught:
        ShapingSettings.model_validate({field: value})
    assert reason in caught.value.errors()[0]["msg"]


def loaded(*options: str) -> GatewaySettings:
    return load(GatewaySettings, ["--robot", "r1", *options], prog="gateway").settings


def test_the_command_line_takes_them_at_once_or_one_by_one() -> None:
    settings = loaded("--max-hz", "10,*/depth=5", "--max-hz", "rear/color=1", "--compression", "*/color=jpeg:90")
    assert [settings.max_hz_of(name) for name in ("front/color", "front/depth", "rear/color")] == [10, 5, 1]
    assert str(settings.method_of("front/color")) == "jpeg:90"
    assert str(settings.method_of("front/depth")) == "auto"
    assert loaded("--uplink-mbit", "20").uplink_mbit == 20


@pytest.mark.parametrize(("text", "expected"), [("10", 10), ("10,*/color=2.5", 2.5), ("*/color=3", 3)])
def test_so_does_the_environment(text: str, expected: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEETSIGHT_MAX_HZ", text)
    assert loaded().max_hz_of("front/color") == expected


@pytest.mark.parametrize(
    "text", ["max_hz: 5", "max-hz: '5'", "max_hz: [9, front/color=5]", "max_hz: {'*': 9, '*/color': 5}"]
)
def test_and_so_does_a_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "gateway.yaml").write_text(text, encoding="utf-8")
    assert loaded("--config", str(tmp_path / "gateway.yaml")).max_hz_of("front/color") == 5


def test_a_wrong_one_is_one_line() -> None:
    with pytest.raises(UsageError, match=r"^--compression \['webp'\]: 'webp' is not one of auto, raw, jpeg"):
        loaded("--compression", "webp")


def test_what_is_asked_for_of_no_stream_that_there_is_may_be_misspelt() -> None:
    settings = ShapingSettings(
        max_hz=["10", "fornt/color=5", "*/points=1"], scale=["front/*=1/2"], compression=["x/depth=png"]
    )
    assert list(settings.unused_shaping(["front/color", "tf"])) == ["--max-hz fornt/color", "--compression x/depth"]
