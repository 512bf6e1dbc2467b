"""Packages of somebody else that are called like ours, on PYTHONPATH and in the working directory."""

import re
import signal
import subprocess
from pathlib import Path

import pytest

from services.toolbox.commands import COMMANDS
from tests.fleetsight.workspaces import DECOY, ROOT, decoys, install, sourced

NOBODY = ("--connect", "tcp/127.0.0.1:9")


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"))


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    return decoys(tmp_path / "workspace")


def run(command: list[str | Path], workspace: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=100, cwd=workspace, env=sourced(workspace)
    )


def test_the_decoys_would_be_found_first(command: Path, workspace: Path) -> None:
    ended = run([command.parent / "python", "-m", "services.toolbox"], workspace)
    assert DECOY in ended.stderr


@pytest.mark.parametrize("name", [each.name for each in COMMANDS])
def test_every_command_reads_its_settings(command: Path, workspace: Path, name: str) -> None:
    ended = run([command, name, "--no-such-option"], workspace)
    assert ended.stderr == f"fleetsight {name}: unrecognized arguments: --no-such-option\n"
    assert ended.returncode == 2


LOADING = """
import importlib, sys
from fleetsight import own_packages
own_packages.put_first(own_packages.ALL)
from services.toolbox.commands import COMMANDS
for command in COMMANDS:
    command.load_settings(), command.load_run(), command.load_refusals()
for name in own_packages.ALL:
    print(sys.modules[name].__file__)
"""


def test_what_every_command_runs_is_ours(command: Path, workspace: Path) -> None:
    ended = run([command.parent / "python", "-c", LOADING], workspace)
    assert ended.stderr == ""
    assert {Path(line).resolve().parents[1] for line in ended.stdout.splitlines()} == {ROOT}


def test_an_editable_install_finds_its_own_too(workspace: Path, tmp_path: Path) -> None:
    command = install(tmp_path / "editable", editable=True)
    assert run([command, "users", "list", "--history", "sqlite:////nowhere"], workspace).stderr == (
        "fleetsight users: /nowhere: it does not exist\n"
    )
    assert run([command.parent / "python", "-c", LOADING], workspace).stderr == ""


def test_as_a_module_it_is_the_same(command: Path, workspace: Path) -> None:
    ended = run([command.parent / "python", "-m", "fleetsight", "--help"], workspace)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("usage: fleetsight COMMAND")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["gateway", "--robot", "r1", "--ros-master", "http://127.0.0.1:9", *NOBODY], "waiting for the ROS master"),
        (["distance", *NOBODY], "waiting for"),
        (["cloud", *NOBODY], "waiting for"),
    ],
    ids=lambda each: each[0] if isinstance(each, list) else None,
)
def test_what_runs_until_it_is_told_to_stop_runs(
    command: Path, workspace: Path, arguments: list[str], said: str
) -> None:
    with subprocess.Popen(
        [command, *arguments], stderr=subprocess.PIPE, text=True, cwd=workspace, env=sourced(workspace)
    ) as running:
        assert running.stderr is not None
        lines = []
        for line in running.stderr:
            lines.append(line)
            if said in line:
                running.send_signal(signal.SIGTERM)
    assert running.returncode == 0, lines
    assert DECOY not in "".join(lines)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["detector", "--model", "absent.pt", *NOBODY], 2, "fleetsight detector: .*absent.pt"),
        (["call", "r1", "/reset", "--timeout-s", "0.1", *NOBODY], 1, "fleetsight call: /reset of r1: "),
        (["users", "list", "--history", "sqlite:////nowhere"], 2, "fleetsight users: /nowhere: "),
        (["history", "export", "--to", "x.csv", "--history", "sqlite:////nowhere"], 2, "fleetsight history: /nowhere"),
        (["doctor", "--robot", "r1", "--ros-master", "http://127.0.0.1:9", *NOBODY], 1, ""),
    ],
    ids=lambda each: each[0] if isinstance(each, list) else None,
)
def test_what_has_an_end_comes_to_it(
    command: Path, workspace: Path, arguments: list[str], code: int, said: str
) -> None:
    ended = run([command, *arguments], workspace)
    assert ended.returncode == code, ended.stderr
    assert re.match(said, ended.stderr)
    assert "Traceback" not in ended.stderr


SPAWNING = """
import os, sys
from pathlib import Path

if __name__ == "__main__":  # where the command is a module, the processes it begins do not import that one either
    import fleetsight.spawned_process
    from services.training import parallel

    parallel.run(os.mkdir, [Path(sys.argv[1], str(number)) for number in range(4)], 2, lambda done: None)
"""


def test_processes_that_multiprocessing_begins_find_ours_too(command: Path, workspace: Path, tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    (tmp_path / "program.py").write_text(SPAWNING)
    ended = run([command.parent / "python", tmp_path / "program.py", tmp_path / "made"], workspace)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert len(list((tmp_path / "made").iterdir())) == 4


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """A workspace with packages that can be imported."""
    for name in ("services", "gateway", "schemas"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("THEIRS = True\n")
        (tmp_path / name / "own.py").touch()
    return tmp_path


def program(command: Path, workspace: Path, text: str) -> subprocess.CompletedProcess[str]:
    return run([command.parent / "python", "-c", text], workspace)


def test_a_program_that_imports_fleetsight_keeps_its_own_services_and_gateway(command: Path, theirs: Path) -> None:
    text = "import fleetsight, services, gateway, bus\nprint(services.THEIRS, gateway.THEIRS, bus.LATEST)"
    assert program(command, theirs, text).stdout == "True True Latest()\n"


@pytest.mark.parametrize("wanted", ["import schemas.own", "from schemas import own", "from schemas import THEIRS"])
def test_a_package_that_ours_hides_is_named_with_the_cure(command: Path, theirs: Path, wanted: str) -> None:
    ended = program(command, theirs, f"import fleetsight\n{wanted}")
    last = ended.stderr.splitlines()[-1]
    assert last.startswith("ModuleNotFoundError: no schemas.")
    assert last.endswith(
        f"fleetsight needs 'schemas' to be that package, not {theirs}/schemas;"
        " rename that one, or use fleetsight in a process of its own"
    )


def test_a_package_that_was_imported_before_ours_is_named_with_the_cure(command: Path, theirs: Path) -> None:
    last = program(command, theirs, "import schemas\nimport fleetsight").stderr.splitlines()[-1]
    assert last == (
        f"ImportError: 'schemas' is another package here than fleetsight's: {theirs}/schemas/__init__.py;"
        " rename that one, or use fleetsight in a process of its own"
    )


def test_a_module_that_nobody_has_is_not_found_as_ever(command: Path, tmp_path: Path) -> None:
    last = program(command, tmp_path, "import fleetsight\nimport schemas.absent").stderr.splitlines()[-1]
    assert last == "ModuleNotFoundError: No module named 'schemas.absent'"


def test_the_command_says_in_one_line_what_is_in_its_way(command: Path, theirs: Path) -> None:
    (theirs / "sitecustomize.py").write_text("import services\n")
    ended = run([command, "--help"], theirs)
    assert ended.stderr == (
        f"fleetsight: 'services' is another package here than fleetsight's: {theirs}/services/__init__.py;"
        " rename that one, or use fleetsight in a process of its own\n"
    )
    assert ended.returncode == 1
