import os
from pathlib import Path
from typing import Annotated, Self

import pytest
from pydantic import AfterValidator, BaseModel, Field, model_validator

from services.toolbox.errors import UsageError
from services.toolbox.settings import Loaded, load


def _place(name: str) -> str:
    if name == "nowhere":
        raise ValueError(f"{name!r} is no place")
    return name


class Settings(BaseModel):
    """Settings of a test."""

    robot: str = Field(pattern="^[a-z0-9]+$")
    connect: list[Annotated[str, AfterValidator(_place)]] = ["here"]
    cameras: dict[str, str] = {"camera": "/image"}
    rate_hz: float = Field(default=1, gt=0)
    least_m: int = 1
    most_m: int = 2
    master: Annotated[str, AfterValidator(_place)] = Field(
        default_factory=lambda: os.environ.get("ROS_MASTER_URI", "there"),
        validate_default=True,
        description="the master; ROS_MASTER_URI unless given",
    )
    image: Path | None = None
    shared: bool = True
    as_json: bool = Field(default=False, alias="json")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.least_m > self.most_m:
            raise ValueError(f"least_m: {self.least_m} is more than most_m")
        if self.image is not None and not self.image.is_file():
            raise ValueError(f"--image {self.image}: no such file")
        return self


def read(*argv: str) -> Loaded[Settings]:
    return load(Settings, argv, prog="test")


def test_defaults_and_options() -> None:
    loaded = read("--robot", "r1", "--connect", "a", "--connect", "b", "--cameras", "front=/f", "--no-shared")
    assert loaded.settings == Settings(robot="r1", connect=["a", "b"], cameras={"front": "/f"}, shared=False)
    assert loaded.log_level is None


def test_an_option_may_be_called_other_than_its_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read("--robot", "r1", "--json").settings.as_json
    monkeypatch.setenv("JSON", "1")
    assert not read("--robot", "r1").settings.as_json
    monkeypatch.setenv("FLEETSIGHT_JSON", "1")
    assert read("--robot", "r1").settings.as_json


def test_options_win_over_environment_over_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("robot: file\nrate-hz: 2\nconnect: [file]\nlog_level: debug\n")
    monkeypatch.setenv("FLEETSIGHT_CONFIG", str(file))
    monkeypatch.setenv("FLEETSIGHT_ROBOT", "environment")
    monkeypatch.setenv("FLEETSIGHT_RATE_HZ", "3")
    loaded = read("--rate-hz", "4")
    assert loaded.settings == Settings(robot="environment", rate_hz=4, connect=["file"])
    assert loaded.log_level == "debug"


def test_lists_and_mappings_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEETSIGHT_CONNECT", "a, b")
    monkeypatch.setenv("FLEETSIGHT_CAMERAS", "front=/f,rear=/r")
    assert read("--robot", "r1").settings == Settings(
        robot="r1", connect=["a", "b"], cameras={"front": "/f", "rear": "/r"}
    )
    monkeypatch.setenv("FLEETSIGHT_CONNECT", '["c"]')
    assert read("--robot", "r1").settings.connect == ["c"]


@pytest.mark.parametrize("name", ["7", "1.5", "007"])
def test_a_list_of_one_name_in_the_environment_is_text_as_on_the_command_line(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FLEETSIGHT_CONNECT", name)
    assert read("--robot", "r1").settings.connect == [name]
    assert read("--robot", "r1", "--connect", name).settings.connect == [name]


def test_toml_file(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text('robot = "r1"\n[cameras]\nfront = "/f"\n')
    assert read("--config", str(file)).settings == Settings(robot="r1", cameras={"front": "/f"})


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ((), "--robot is required (or FLEETSIGHT_ROBOT, or in the file that --config names)"),
        (("--robot", "R"), "--robot 'R': String should match pattern '^[a-z0-9]+$'"),
        (("--robot", "r", "--rate-hz", "0"), "--rate-hz '0': Input should be greater than 0"),
        (("--robot", "r", "--rate-hz", "nan"), "--rate-hz 'nan': Input should be a finite number"),
        (("--robot", "r", "--rate-hz=-inf"), "--rate-hz '-inf': Input should be a finite number"),
        (("--robot", "r", "--image", "a\udcff"), "--image: not UTF-8"),
        (("--robot", "r", "--image=a\udcff"), "--image: not UTF-8"),
        (("--robot", "r", "--config", ""), "--config names no file"),
        (("--robot", "r", "--rate-hz", "fast"), "--rate-hz 'fast': Input should be a valid number"),
        (("--robot", "r", "--robt", "r"), "unrecognized arguments: --robt r; did you mean --robot?"),
        (("--robot", "r", "--rat-hz=1"), "unrecognized arguments: --rat-hz=1; did you mean --rate-hz?"),
        (("--robot", "r", "front"), "unrecognized arguments: front (usage: test [OPTION ...])"),
        (("--robot",), "argument --robot: expected one argument"),
        (("--robot", "r", "--cameras", "front"), "--cameras: write it like name=value"),
        (("--robot", "r", "--connect", "a", "--connect", "nowhere"), "--connect: 'nowhere' is no place"),
        (("--robot", "r", "--cameras", "front=/a,front=/b"), "--cameras: front is given twice"),
        (("--robot", "r", "--cameras", "front=/a", "--cameras=front=/b"), "--cameras: front is given twice"),
        (("--robot", "r", "--least-m", "3"), "--least-m: 3 is more than --most-m"),
        (("--robot", "r", "--config", "missing.yaml"), "--config missing.yaml: No such file"),
    ],
)
def test_a_wrong_setting_is_named_on_one_line(argv: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError) as caught:
        read(*argv)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "robt = 'r'", "a.toml: 'robt' is not a setting; did you mean robot?"),
        ("a.toml", "robot =", "Invalid value"),
        ("a.toml", "robot = 'r'\nleast-m = 1\nleast_m = 2", "a.toml: 'least_m' is given twice"),
        ("a.yaml", "robot: [", "a.yaml: line 1: expected the node content"),
        ("a.yaml", "robot: r\nrobt: r", "a.yaml: line 2: 'robt' is not a setting; did you mean robot?"),
        ("a.yaml", "robot: r1\nrobot: r2", "a.yaml: line 2: 'robot' is given twice"),
        ("a.yaml", "robot: r\nleast-m: 1\nleast_m: 2", "a.yaml: line 3: 'least_m' is given twice"),
        ("a.yaml", "robot: r\ncameras:\n  front: /a\n  front: /b", "a.yaml: line 4: 'front' is given twice"),
        ("a.yaml", "robot: r\nrate-hz: yes", "a.yaml: line 2: rate_hz: yes and no are not valid here"),
        ("a.yaml", "robot: r\nconnect: [a, no]", "a.yaml: line 2: connect: yes and no are not valid here"),
        ("a.yaml", "robot: no", "a.yaml: line 1: robot: yes and no are not valid here; quote them to make them text"),
        ("a.yaml", "robot: r\nconfig: b.yaml", "a.yaml: line 2: 'config' cannot be set in a file"),
        ("a.yaml", "- robot", "not a mapping; write settings as name: value pairs"),
        ("a.yaml", "robot: r\nrate-hz: -1", "a.yaml: line 2: rate_hz -1: Input should be greater than 0"),
        ("a.yaml", "robot: \x00", "unacceptable character"),
        ("a.yaml", "robot: 2026-13-01", "a.yaml: line 1: '2026-13-01' is no timestamp"),
        ("a.yaml", "[" * 2_000, "maximum recursion depth"),
    ],
)
def test_a_mistake_in_the_file_is_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(UsageError) as caught:
        read("--config", str(file))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_help_lists_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        read("--help")
    assert caught.value.code == 0
    shown = capsys.readouterr().out
    assert all(f"--{option}" in shown for option in ("robot", "connect", "cameras", "rate-hz", "config", "log-level"))


@pytest.mark.parametrize("value", ["front", "front,rear=/r", "front=/a,front=/b"])
def test_pairs_that_are_none_name_their_variable(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEETSIGHT_CAMERAS", value)
    with pytest.raises(UsageError, match=r"FLEETSIGHT_CAMERAS .*: write it like name=value"):
        read("--robot", "r1")


def test_a_lone_text_in_the_file_is_a_list_of_one(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("robot: r1\nconnect: there\n")
    assert read("--config", str(file)).settings.connect == ["there"]


def test_a_mistake_is_where_it_was_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("robot: r1\nrate_hz: -1\n")
    monkeypatch.setenv("FLEETSIGHT_RATE_HZ", "-2")
    with pytest.raises(UsageError, match=r"^FLEETSIGHT_RATE_HZ '-2': Input"):
        read("--config", str(file))
    with pytest.raises(UsageError, match=r"^--rate-hz '-3': Input"):
        read("--config", str(file), "--rate-hz=-3")


def test_yes_and_no_in_the_file_are_for_settings_that_are_one_of_them(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("robot: r1\nshared: no\njson: yes\nconnect: ['no']\n")
    settings = read("--config", str(file)).settings
    assert (settings.shared, settings.as_json, settings.connect) == (False, True, ["no"])


def test_a_mistake_in_the_environment_is_named_by_its_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "nowhere")
    with pytest.raises(UsageError, match=r"^ROS_MASTER_URI: 'nowhere' is no place$"):
        read("--robot", "r1")
    with pytest.raises(UsageError, match=r"^--master: 'nowhere' is no place$"):
        read("--robot", "r1", "--master", "nowhere")
    monkeypatch.delenv("ROS_MASTER_URI")
    monkeypatch.setenv("FLEETSIGHT_CONFIG", str(tmp_path / "nope"))
    with pytest.raises(UsageError, match=r"^FLEETSIGHT_CONFIG .*/nope: No such file or directory$"):
        read("--robot", "r1")
    with pytest.raises(UsageError, match=r"^--config nope: No such file or directory$"):
        read("--robot", "r1", "--config", "nope")
    monkeypatch.setenv("FLEETSIGHT_CONFIG", "")
    with pytest.raises(UsageError, match=r"^FLEETSIGHT_CONFIG names no file$"):
        read("--robot", "r1")
    monkeypatch.delenv("FLEETSIGHT_CONFIG")
    monkeypatch.setenv("FLEETSIGHT_IMAGE", "a\udcff")
    with pytest.raises(UsageError, match=r"^FLEETSIGHT_IMAGE: not UTF-8$"):
        read("--robot", "r1")
