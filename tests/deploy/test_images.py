"""The images, made by the Containerfile on Debian's Python, and the fleet of compose.yaml running in them."""

import json
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from services.toolbox.settings import load
from tests.deploy.machine import make_root, make_wheels, require_containers
from tests.deploy.podman import PYTHON, Podman
from tests.deploy.units import DEPLOY, command

pytestmark = pytest.mark.timeout(600)

EXTRAS = {
    "gateway": "",
    "space": "distance,cloud,worldmodel",
    "simulator": "simulator",
    "monitor": "monitor",
}
"""All but the detector's: torch alone has more bytes than all of these, and comes from the network."""

GATEWAY_MB = 350
STARTED = ("monitor", "worldmodel", "distance", "cloud", "simulator", "gateway")
DEADLINE_S = 60


@pytest.fixture(scope="module")
def podman(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Podman]:
    require_containers()
    folder = tmp_path_factory.mktemp("podman")
    wheels = make_wheels(folder / "wheels", ",".join(filter(None, EXTRAS.values())))
    found = Podman(folder)
    try:
        found.run("import", "--quiet", make_root(folder / "root.tar"), PYTHON)
        for target in EXTRAS:
            found.build(target, wheels)
        yield found
    finally:
        found.close()


@pytest.mark.parametrize("target", EXTRAS)
def test_an_image_runs_without_rights_and_without_tools_to_build_with(podman: Podman, target: str) -> None:
    image = f"localhost/fleetsight-{target}"
    assert podman.once(image, "--version") == f"fleetsight {version('fleetsight')}\n"
    assert podman.once(image, "-u", entry="id") == "10001\n"
    present = "import shutil; print([name for name in ('gcc', 'pip', 'git', 'curl') if shutil.which(name)])"
    assert podman.once(image, "-c", present, entry="/opt/fleetsight/bin/python3") == "[]\n"
    (described,) = json.loads(podman.run("inspect", image))
    assert described["Config"]["User"] == "10001:10001"
    assert described["Config"]["Labels"]["org.opencontainers.image.licenses"] == "AGPL-3.0-or-later"


def test_a_gateway_s_image_is_small(podman: Podman) -> None:
    (described,) = json.loads(podman.run("inspect", "localhost/fleetsight-gateway"))
    assert described["Size"] / 1e6 <= GATEWAY_MB


@pytest.fixture(scope="module")
def fleet(podman: Podman) -> Iterator[Podman]:
    podman.compose("up", "--detach", "--no-build", *STARTED)
    yield podman
    podman.compose("down", "--volumes")


def eventually(fleet: Podman, name: str, said: str, *options: str) -> None:
    end = time.monotonic() + DEADLINE_S
    while said not in fleet.logs(f"deploy_{name}_1", *options):
        assert time.monotonic() < end, {each: fleet.logs(f"deploy_{each}_1") for each in STARTED}
        time.sleep(0.5)


def test_a_simulated_robot_s_data_reaches_the_centre(fleet: Podman) -> None:
    eventually(fleet, "monitor", "r1/camera: online")
    eventually(fleet, "distance", "serving 1 cameras")
    eventually(fleet, "worldmodel", "serving it")
    told = fleet.run("exec", "deploy_gateway_1", "fleetsight", "doctor", "--connect", "tcp/monitor:7447")
    assert "r1: its gateway" in told


def test_the_monitor_is_healthy(fleet: Podman) -> None:
    fleet.run("healthcheck", "run", "deploy_monitor_1")


def test_a_process_that_is_killed_keeps_what_it_had(fleet: Podman) -> None:
    fleet.run("kill", "--signal=KILL", "deploy_monitor_1")
    fleet.run("start", "deploy_monitor_1")
    eventually(fleet, "monitor", "r1/camera: online", "--since=1m")


def test_all_end_in_order(fleet: Podman) -> None:
    for name in reversed(STARTED):
        fleet.run("stop", "--time=10", f"deploy_{name}_1")
        (described,) = json.loads(fleet.run("inspect", f"deploy_{name}_1"))
        assert (name, described["State"]["ExitCode"]) == (name, 0)


def test_each_service_of_compose_has_settings_that_its_command_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))["services"]
    monkeypatch.delenv("FLEETSIGHT_HISTORY", raising=False)
    assert set(STARTED) | {"detector"} == set(services)
    for service in services.values():
        name, *options = service["command"]
        load(command(name).load_settings(), options, prog=f"fleetsight {name}")
        assert service["read_only"]
        assert service["cap_drop"] == ["ALL"]


def test_every_target_is_told_and_every_folder_that_is_copied_is_there() -> None:
    text = (DEPLOY / "Containerfile").read_text(encoding="utf-8")
    targets = [line.split()[-1] for line in text.splitlines() if line.startswith("FROM base AS")]
    assert sorted(targets) == sorted([*EXTRAS, "detector", "detector-cpu"])
    for line in text.splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            assert all((DEPLOY.parent / name).exists() for name in line.split()[1:-1])
            assert {f"!{name}" for name in line.split()[1:-1]} <= set(
                (DEPLOY.parent / Path(".containerignore")).read_text(encoding="utf-8").splitlines()
            )
