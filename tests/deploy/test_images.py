"""The images, made by the Containerfile on Debian's Python; the fleet of compose.yaml and the chart's pods in them."""

import json
import re
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml

from services.toolbox.settings import load
from tests.deploy import secured
from tests.deploy.helm import NAME, render
from tests.deploy.kube import playable
from tests.deploy.machine import require_containers, root_archive, wheels
from tests.deploy.old_podman import REFUSING, OldPodman
from tests.deploy.podman import PYTHON, Podman
from tests.deploy.units import DEPLOY, command

pytestmark = pytest.mark.timeout(1200)  # seven images are built first

EXTRAS = {
    "gateway": "pki",
    "space": "distance,cloud,worldmodel",
    "detector-cpu": "detector-onnx",
    "simulator": "simulator",
    "monitor": "monitor,pki",
}
"""All but the detector's for GPUs: its torch alone has more bytes than all of these, and comes from the network."""

LARGEST_MB = {"gateway": 350, "detector-cpu": 600}
PEERS = ("postgresql", "prometheus")
"""Debian's own, that compose.yaml has beside ours."""

STARTED = ("postgresql", "prometheus", "monitor", "worldmodel", "distance", "cloud", "detector", "simulator", "gateway")
DEADLINE_S = 60


@pytest.fixture(scope="module")
def podman(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Podman]:
    require_containers()
    found = Podman()
    try:
        found.run("import", "--quiet", root_archive(tmp_path_factory), PYTHON)
        for target in (*EXTRAS, *PEERS):
            found.build(target, wheels(tmp_path_factory))
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
    labels = described["Config"]["Labels"]
    assert labels["org.opencontainers.image.licenses"] == "AGPL-3.0-or-later"
    assert labels["org.opencontainers.image.version"] == version("fleetsight")


@pytest.mark.parametrize("target", ["gateway", "monitor"])
def test_a_robot_s_image_and_a_router_s_can_get_certificates(podman: Podman, target: str) -> None:
    made = podman.once(f"localhost/fleetsight-{target}", "pki", "init", "--folder", "/tmp/pki")  # noqa: S108 - its own
    assert made.startswith("/tmp/pki/ca.pem: the fleet's authority")  # noqa: S108


@pytest.mark.parametrize("target", LARGEST_MB)
def test_an_image_for_robots_and_one_for_processors_are_small(podman: Podman, target: str) -> None:
    (described,) = json.loads(podman.run("inspect", f"localhost/fleetsight-{target}"))
    assert described["Size"] / 1e6 <= LARGEST_MB[target]


def test_a_robot_s_image_runs_under_a_podman_of_ubuntu_20_04_s_age(podman: Podman, tmp_path: Path) -> None:
    """Its C library starts threads by clone3, which is newer; a Docker that refuses that cannot run the image."""
    image, archive = "localhost/fleetsight-gateway", tmp_path / "gateway.tar"
    podman.run("save", "--quiet", "--format=docker-archive", f"--output={archive}", image)
    old = OldPodman(tmp_path / "tree")
    old.load(archive)
    doctor = ("doctor", "--robot=r1", "--ros-master=http://127.0.0.1:1", "--connect=tcp/127.0.0.1:1")
    assert old.run(image, "--version").stdout == f"fleetsight {version('fleetsight')}\n"
    assert "tcp/127.0.0.1:1: no router listens there" in old.run(image, *doctor).stdout
    refusing = f"--security-opt=seccomp=/srv/{REFUSING}"
    assert "can't start new thread" in old.run(refusing, image, "--version").stderr
    unconfined = old.run("--security-opt=seccomp=unconfined", image, *doctor)
    assert "tcp/127.0.0.1:1: no router listens there" in unconfined.stdout, unconfined.stderr


@pytest.fixture(scope="module")
def fleet(podman: Podman) -> Iterator[Podman]:
    podman.compose("up", "--detach", "--no-build", *STARTED)
    yield podman
    podman.compose("down", "--volumes")


def eventually(podman: Podman, container: str, said: str, *options: str) -> None:
    end = time.monotonic() + DEADLINE_S
    while said not in podman.logs(container, *options):
        names = podman.run("ps", "--all", "--format={{.Names}}").split()
        assert time.monotonic() < end, {each: podman.logs(each) for each in names}
        time.sleep(0.5)


def test_a_simulated_robot_s_data_reaches_the_centre(fleet: Podman) -> None:
    eventually(fleet, "deploy_monitor_1", "r1/camera: online")
    eventually(fleet, "deploy_distance_1", "serving 1 cameras")
    eventually(fleet, "deploy_worldmodel_1", "serving it")
    told = fleet.run("exec", "deploy_gateway_1", "fleetsight", "doctor", "--connect", "tcp/monitor:7447")
    assert "r1: its gateway" in told


def test_what_the_detector_sees_reaches_a_program_as_the_demo_checks(fleet: Podman) -> None:
    """The program runs where the gateway alone is installed; the check is the demo's: class lists of each robot."""
    script = (
        "import asyncio, fleetsight\n"
        "async def main():\n"
        "    async with fleetsight.connect('tcp/monitor:7447') as fleet:\n"
        "        async for seen in fleet.class_lists('r1'):\n"
        "            if any(each.count for each in seen.classes):\n"
        "                return print(seen.header.robot, seen.model)\n"
        "asyncio.run(asyncio.wait_for(main(), 90))\n"
    )
    seen = fleet.run("exec", "deploy_gateway_1", "python3", "-c", script)
    assert seen == "r1 warehouse-n-seg.onnx\n"


@pytest.mark.parametrize("name", [each for each in STARTED if each != "prometheus"])
def test_each_process_is_healthy(fleet: Podman, name: str) -> None:
    fleet.run("healthcheck", "run", f"deploy_{name}_1")


def test_a_process_whose_event_loop_stands_still_is_unhealthy(fleet: Podman) -> None:
    fleet.run("exec", "deploy_distance_1", "python3", "-c", "import os; os.utime('/tmp/heartbeat', (0, 0))")
    with pytest.raises(AssertionError):
        fleet.run("healthcheck", "run", "deploy_distance_1")


def test_the_history_is_in_postgresql(fleet: Podman) -> None:
    count = ["sh", "-c", 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -Atc "table presence"']
    end = time.monotonic() + DEADLINE_S
    while "r1||" not in (rows := fleet.run("exec", "deploy_postgresql_1", *count)):
        assert time.monotonic() < end, rows
        time.sleep(0.5)


def test_prometheus_has_the_metrics_and_our_rules(fleet: Podman) -> None:
    query = ["exec", "deploy_prometheus_1", "promtool", "query", "instant", "http://127.0.0.1:9090"]
    end = time.monotonic() + DEADLINE_S
    for asked, said in (
        ('fleetsight_robot_online{robot="r1"}', "=> 1 @"),
        ("fleetsight:detector_load", r"=> 0\.\d+ @"),
    ):
        while not re.search(said, answer := fleet.run(*query, asked)):
            assert time.monotonic() < end, f"{answer}{fleet.logs('deploy_prometheus_1')}"
            time.sleep(0.5)


def test_a_process_that_is_killed_keeps_what_it_had(fleet: Podman) -> None:
    fleet.run("kill", "--signal=KILL", "deploy_monitor_1")
    fleet.run("start", "deploy_monitor_1")
    eventually(fleet, "deploy_monitor_1", "r1/camera: online", "--since=1m")


def test_all_end_in_order(fleet: Podman) -> None:
    for name in reversed(STARTED):
        fleet.run("stop", "--time=10", f"deploy_{name}_1")
        (described,) = json.loads(fleet.run("inspect", f"deploy_{name}_1"))
        assert (name, described["State"]["ExitCode"]) == (name, 0)


def test_the_chart_s_pods_with_certificates_keep_their_history_in_postgresql(podman: Podman, tmp_path: Path) -> None:
    """Ends before `cluster` begins, whose pods have the same names."""
    manifests = playable([*render(secured.VALUES), *secured.make_secrets(tmp_path)], tmp_path)
    joined = ["run", "--detach", "--pull=never", "--read-only", "--cap-drop=all"]
    with podman.playing(manifests, "cluster"):
        password = f"--env=PASSWORD={secured.PASSWORD}"
        database = [password, "--tmpfs=/tmp", "--network=cluster", "localhost/fleetsight-postgresql"]
        podman.run(*joined, "--name=database", *database)
        robot = ["localhost/fleetsight-simulator", "simulate", "--robots=1", "--master-port=11311"]
        podman.run(*joined, "--name=robot", "--network=cluster", *robot)
        gateway = ["gateway", f"--robot={secured.ROBOT}", f"--connect=tls/{NAME}-monitor:7447", "--tls=/tls/r1"]
        beside = ["--network=container:robot", f"--volume={tmp_path}/robot:/tls:ro", "localhost/fleetsight-gateway"]
        podman.run(*joined, "--name=gateway", *beside, *gateway)
        eventually(podman, pod("monitor"), "r1/camera: online")
        eventually(podman, pod("distance"), "serving 1 cameras")
        eventually(podman, pod("worldmodel"), "serving it")
        present = 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -Atc "table presence"'
        end = time.monotonic() + DEADLINE_S
        while "r1||" not in (rows := podman.run("exec", "database", "sh", "-c", present)):
            assert time.monotonic() < end, rows
            time.sleep(0.5)
        add = (
            "echo a-long-password | fleetsight users add alice --role viewer >/dev/null && fleetsight users token alice"
        )
        token = podman.run("exec", pod("monitor"), "sh", "-c", add).split()[-1]
        assert ask(podman, "/healthz")[0] == '{"status":"ok"}', "links are open to all, or something is wrong"
        assert ask(podman, "/metrics")[1] == "401"
        end = time.monotonic() + DEADLINE_S
        while (answer := ask(podman, "/metrics", f"Authorization: Bearer {token}"))[1] != "200":
            assert time.monotonic() < end, answer  # a running monitor knows new users within seconds
            time.sleep(0.5)
        assert 'fleetsight_robot_online{robot="r1"} 1.0' in answer[0]


def ask(podman: Podman, path: str, *headers: str) -> tuple[str, str]:
    """Return what the monitor answers another pod, as Prometheus would ask it, and its status."""
    script = (
        "import sys, urllib.error, urllib.request as web\n"
        "asked = web.Request(sys.argv[1], headers=dict(each.split(': ') for each in sys.argv[2:]))\n"
        "try: answer = web.urlopen(asked, timeout=9)\n"
        "except urllib.error.HTTPError as error: answer = error\n"
        "print(answer.read().decode() + '\\n' + str(answer.status))"
    )
    url = f"http://{NAME}-monitor:8080{path}"
    body, _, status = (
        podman.run("exec", pod("distance"), "python3", "-c", script, url, *headers).strip().rpartition("\n")
    )
    return body, status


@pytest.fixture(scope="module")
def cluster(podman: Podman) -> Iterator[tuple[Podman, list[Mapping[str, Any]]]]:
    """The chart's pods, and beside them a simulated robot with its gateway."""
    objects = render({"image": {"tag": "latest"}, "monitor": {"openMetrics": True}})
    with podman.playing(playable(objects), "cluster"):
        confined = ["--detach", "--pull=never", "--read-only", "--cap-drop=all"]
        robot = ["localhost/fleetsight-simulator", "simulate", "--robots=1", "--master-port=11311"]
        podman.run("run", *confined, "--name=robot", "--network=cluster", *robot)
        gateway = ["localhost/fleetsight-gateway", "gateway", "--robot=r1", f"--connect=tcp/{NAME}-monitor:7447"]
        podman.run("run", *confined, "--name=gateway", "--network=container:robot", *gateway)
        yield podman, [each["spec"]["template"]["spec"] for each in objects if "template" in each.get("spec", {})]


def test_the_chart_s_pods_serve_a_robot_and_pass_their_probes(
    cluster: tuple[Podman, list[Mapping[str, Any]]],
) -> None:
    podman, pods = cluster
    eventually(podman, pod("monitor"), "r1/camera: online")
    eventually(podman, pod("distance"), "serving 1 cameras")
    eventually(podman, pod("cloud"), "serving 1 cameras")
    eventually(podman, pod("worldmodel"), "serving it")
    eventually(podman, pod("detector"), "serving 1 cameras")
    read = "import urllib.request as web; print(web.urlopen('http://{}-monitor:8080{}', timeout=9).read().decode())"
    probes = {each["containers"][0]["name"]: each["containers"][0]["livenessProbe"] for each in pods}
    assert probes.keys() == {"monitor", "detector", "distance", "cloud", "worldmodel"}
    for name, probe in probes.items():
        if name == "monitor":
            answer = podman.run("exec", pod("cloud"), "python3", "-c", read.format(NAME, probe["httpGet"]["path"]))
            assert json.loads(answer)["status"] == "ok"
        else:
            podman.run("exec", pod(name), *probe["exec"]["command"])
            *python, script = probe["exec"]["command"]
            hung = f"import os; os.utime('/tmp/heartbeat', (0, 0)); {script}"
            with pytest.raises(AssertionError):
                podman.run("exec", pod(name), *python, hung)
    metrics = podman.run("exec", pod("cloud"), "python3", "-c", read.format(NAME, "/metrics"))
    assert 'fleetsight_robot_online{robot="r1"} 1.0' in metrics
    assert set(re.findall(r'busy_seconds_total{service="(\w+)"', metrics)) == {"detector", "distance", "cloud"}


def pod(process: str) -> str:
    """Return the name of the only container in a pod."""
    return f"{NAME}-{process}-{process}"


def test_each_service_of_compose_has_settings_that_its_command_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))["services"]
    monkeypatch.delenv("FLEETSIGHT_HISTORY", raising=False)
    assert set(STARTED) == set(services)
    for each, service in services.items():
        if each not in PEERS:
            name, *options = service["command"]
            load(command(name).load_settings(), options, prog=f"fleetsight {name}")
        assert service["read_only"]
        assert service["cap_drop"] == ["ALL"]


def test_every_target_is_told_and_every_folder_that_is_copied_is_there() -> None:
    text = (DEPLOY / "Containerfile").read_text(encoding="utf-8")
    targets = [line.split()[-1] for line in text.splitlines() if line.startswith("FROM base AS")]
    assert sorted(targets) == sorted([*EXTRAS, "detector"])
    for line in text.splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            assert all((DEPLOY.parent / name).exists() for name in line.split()[1:-1])
            assert {f"!{name}" for name in line.split()[1:-1]} <= set(
                (DEPLOY.parent / Path(".containerignore")).read_text(encoding="utf-8").splitlines()
            )
