import os
import re
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel

from services.monitor.history.settings import ExportSettings
from services.monitor.settings import UsersSettings
from services.option_names import holds_secret
from services.simulator.settings import SimulatorSettings
from services.toolbox import process
from services.toolbox.command_line import main
from services.toolbox.commands import COMMANDS
from services.toolbox.detect.settings import DetectSettings
from services.toolbox.errors import UsageError
from services.toolbox.settings import load


def test_overview_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {command.name} " in shown for command in COMMANDS)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"fleetsight {version('fleetsight')}\n"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "a command is missing"),
        (["nix"], "no command 'nix'"),
        (["montor"], "no command 'montor'; did you mean monitor?"),
    ],
)
def test_without_a_command(argv: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == process.EXIT_USAGE
    assert capsys.readouterr().err.startswith(f"fleetsight: {message}\n")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_command_has_help_and_something_to_run(command: object, capsys: pytest.CaptureFixture[str]) -> None:
    name = getattr(command, "name", "")
    assert main([name, "--help"]) == 0
    assert f"usage: fleetsight {name}" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_setting_that_may_hold_a_secret_is_known_to(command: object) -> None:
    """By its name; files, numbers and switches hold none themselves."""
    fields = command.load_settings().model_fields  # type: ignore[attr-defined]
    texts = {name: field for name, field in fields.items() if field.annotation in (str, list[str])}
    assert not [
        name
        for name, field in texts.items()
        if re.search("token|password|secret|credential", name) and not holds_secret(field, "x")
    ]
    for name, field in texts.items():
        if name == "history":
            for url in ("postgresql://me:hidden@db/x", "postgresql://db/x?user=me&password=hidden"):
                assert holds_secret(field, url)
            for url in ("postgresql://me@db:5432/x", "sqlite:////var/lib/a:b@c.db", "none"):
                assert not holds_secret(field, url)


@pytest.mark.parametrize("given", ["option", "environment", "no password"])
def test_a_secret_on_the_command_line_is_told_and_never_shown(given: str) -> None:
    url = "postgresql://me@127.0.0.1:1/x" if given == "no password" else "postgresql://me:hidden@127.0.0.1:1/x"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("FLEETSIGHT_")}
    options = ["--history", url]
    if given == "environment":
        options, environment["FLEETSIGHT_HISTORY"] = [], url
    command = [sys.executable, "-m", "services.toolbox", "users", "list", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    told = (
        "fleetsight users: --history holds a secret, which everybody on this machine can see in the list of processes:"
        " give it in FLEETSIGHT_HISTORY, or in the file that --config names\n"
    )
    assert done.returncode != 0
    assert done.stderr.count(told) == (given == "option")
    assert "hidden" not in done.stderr


def test_a_misspelt_setting_in_the_environment_is_told_and_another_commands_is_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("CONECT", "SCREENSHOTS", "ROBOTS"):
        monkeypatch.setenv(f"FLEETSIGHT_{name}", "r1")
    assert main(["gateway"]) == process.EXIT_USAGE
    doubt, refusal = capsys.readouterr().err.splitlines()
    assert doubt == (
        "fleetsight gateway: FLEETSIGHT_CONECT in the environment is not a setting; did you mean FLEETSIGHT_CONNECT?"
    )
    assert refusal.startswith("fleetsight gateway: --robot is required")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_a_wrong_option_is_one_line_and_exit_code_2(command: object) -> None:
    name = getattr(command, "name", "")
    ended = subprocess.run(
        [sys.executable, "-m", "services.toolbox", name, "--no-such-option"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ended.returncode == process.EXIT_USAGE
    assert ended.stderr == f"fleetsight {name}: unrecognized arguments: --no-such-option\n"
    assert ended.stdout == ""


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("argv", [["--help"], ["--version"], ["distance", "--help"]], ids=" ".join)
def test_a_reader_who_has_read_enough_is_no_failure(argv: list[str], unbuffered: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    ended = _printing(argv, writing, unbuffered)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("argv", [["--help"], ["--version"], ["distance", "--help"]], ids=" ".join)
def test_what_could_not_be_written_is_a_failure(argv: list[str], unbuffered: str) -> None:
    with Path("/dev/full").open("w") as full:
        ended = _printing(argv, full.fileno(), unbuffered)
    assert ended.returncode == process.EXIT_FAILED
    assert ended.stderr == "fleetsight: the output cannot be written: No space left on device\n"


def _printing(argv: list[str], to: int, unbuffered: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "services.toolbox", *argv]
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    return subprocess.run(
        command, stdout=to, stderr=subprocess.PIPE, text=True, check=False, timeout=60, env=environment
    )


@pytest.mark.parametrize(
    ("argv", "closed", "code", "said"),
    [
        (["--help"], ">&-", 0, ""),
        (["distance", "--help"], ">&-", 0, ""),
        (["users", "list", "--history", "sqlite:////nowhere"], ">&-", 2, "fleetsight users: /nowhere: "),
        (["gateway"], ">&-", 2, "fleetsight gateway: --robot is required"),
        (["users", "add", "bob", "--history", "sqlite:////nowhere"], "<&-", 2, "fleetsight users: a password has 10"),
        (["nix"], "2>&-", 2, ""),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, list) else None,
)
def test_a_closed_stream_is_one_that_nobody_reads_and_nothing_is_in(
    argv: list[str], closed: str, code: int, said: str
) -> None:
    command = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "services.toolbox", *argv]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == code
    assert ended.stderr.startswith(said)
    assert ended.stderr.count("\n") == bool(said)


@pytest.mark.parametrize("number", process.SIGNALS)
def test_who_is_told_to_stop_before_there_is_anything_to_end_is_done(number: signal.Signals, tmp_path: Path) -> None:
    config = tmp_path / "slow.yaml"
    os.mkfifo(config)
    command = [sys.executable, "-m", "services.toolbox", "demo", "--config", str(config)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as running, config.open("w"):
        running.send_signal(number)
        said, _ = running.communicate(timeout=60)
    assert running.returncode == 0
    assert said == b""


@pytest.mark.parametrize("number", process.SIGNALS)
def test_who_is_told_to_stop_while_everything_is_imported_is_done(number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "pydantic").mkdir()
    (tmp_path / "pydantic" / "__init__.py").write_text("print('importing', flush=True)\nimport time\ntime.sleep(60)\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path.cwd())])}
    command = [sys.executable, "-m", "services.toolbox", "gateway", "--robot", "r1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"importing\n"
        running.send_signal(number)
        assert running.stdout.read() == b""
    assert running.returncode == 0


@pytest.mark.parametrize(
    ("argv", "option"),
    [(["rules", "test"], "--file"), (["monitor", "--rules"], "--rules"), (["monitor", "--floor-plan"], "--floor-plan")],
    ids=lambda each: each if isinstance(each, str) else None,
)
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(
    argv: list[str], option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert main([*argv, str(pipe)]) == process.EXIT_USAGE
    assert capsys.readouterr().err == f"fleetsight {argv[0]}: {option} '{pipe}': not a regular file\n"


EXPORT = ["history", "export", "--to", "a.csv", "--history", "sqlite:////nowhere"]


@pytest.mark.parametrize(
    ("argv", "reason"),
    [
        ([*EXPORT, "--since", "0001-01-01"], "--since '0001-01-01': use a year from 1970 to 2261"),
        ([*EXPORT, "--until", "9999-12-31"], "--until '9999-12-31': use a year from 1970 to 2261"),
        ([*EXPORT, "--since", "2026-11-21", "--until", "2026-11-20"], "--since is later than --until"),
        ([*EXPORT, "--robot", "a/b"], "--robot: robot name 'a/b': use 1 to 64 letters"),
        ([*EXPORT, "--camera", "*"], "--camera: camera name '*': use 1 to 64 letters"),
        (["rules", "test", "a.yaml", "--since", "0001-01-01"], "--since '0001-01-01': use a year from 1970 to 2261"),
        (["users", "list", "--days", "3"], "list takes no --days; only token does"),
        (
            ["monitor", "--stale-s", "10", "--lost-s", "5"],
            "--stale-s 10 is more than --lost-s 5; set it to at most --lost-s",
        ),
        (["monitor", "--refresh-s", "nan"], "--refresh-s 'nan': Input should be a finite number"),
        (["simulate", "--bag", "a.bag", "--ros-master", "http://robot:11311"], "--bag needs no ROS master"),
        (["simulate", "--bag", "a.bag", "--summary"], "--summary counts what is published live"),
        (["simulate", "--bag", "{nope}.bag"], "--bag '{nope}.bag': unknown placeholder {nope}; use {robot}"),
        (["clouds", "save", "r1", "front", "--folder", "/dev/null"], "--folder '/dev/null': no folder"),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, list) else "",
)
def test_settings_that_make_no_sense_are_refused_by_name(
    argv: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(argv) == process.EXIT_USAGE
    said = capsys.readouterr().err
    assert said.startswith(f"fleetsight {argv[0]}: {reason}")
    assert said.count("\n") == 1


def test_a_bag_is_written_whatever_master_ros_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://robot:11311")
    assert SimulatorSettings.model_validate({"bag": "{robot}.bag"}).ros_master == "http://robot:11311"


@pytest.mark.parametrize(
    ("argv", "model", "others"),
    [
        (["--image", __file__], DetectSettings, {"confidence": 0.4, "runtime": "onnx", "model": "a.pt", "nms": True}),
        (
            ["--task", "compact", "--history", "sqlite:////nowhere"],
            ExportSettings,
            {"robot": "r1", "camera": "front", "bom": True},
        ),
        (["--task", "list"], UsersSettings, {"role": "viewer", "days": 3}),
        (["--bag", "a.bag"], SimulatorSettings, {"ros_master": "http://robot:11311", "summary": True}),
    ],
    ids=lambda each: each.__name__ if isinstance(each, type) else "",
)
def test_an_environment_or_a_file_of_several_commands_may_say_more_than_one_of_them_takes(
    argv: list[str], model: type[BaseModel], others: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "shared.yaml"
    file.write_text(yaml.safe_dump(others), encoding="utf-8")
    load(model, [*argv, "--config", str(file)], prog="fleetsight")
    for name, value in others.items():
        monkeypatch.setenv(f"FLEETSIGHT_{name.upper()}", str(value))
    load(model, argv, prog="fleetsight")
    for name, value in others.items():
        option = f"--{name.replace('_', '-')}"
        with pytest.raises(UsageError, match=rf"{option}|{name}"):
            load(model, [*argv, option if value is True else f"{option}={value}"], prog="fleetsight")
