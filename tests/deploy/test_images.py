"""The images, made by the Containerfile on Debian's Python; the fleet of compose.yaml and the chart's pods in them."""

import json
import re
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from packaging.utils import canonicalize_name

from deploy.image_bill import find_image
from deploy.release import needed
from services.toolbox.demo.children import free_ports
from tests.deploy.support import secured
from tests.deploy.support.certificates import ROBOT, STRANGER, make_central
from tests.deploy.support.helm import NAME, render
from tests.deploy.support.images import EXTRAS, LARGEST_MB, LOOK, PEERS, REVISION, STARTED
from tests.deploy.support.kube import ask, playable, pod
from tests.deploy.support.machine import wheels
from tests.deploy.support.old_podman import REFUSING, OldPodman
from tests.deploy.support.podman import SIMULATED, Podman, podman_with_debian
from tests.deploy.support.seeing import seeing, simulator
from tests.deploy.support.units import DEPLOY

pytestmark = pytest.mark.timeout(1800)  # seven images are built first

DEADLINE_S = 60


@pytest.fixture(scope="module")
def podman(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Podman]:
    with podman_with_debian(tmp_path_factory) as made:
        made.build(wheels(tmp_path_factory), REVISION)
        yield made


@pytest.mark.parametrize("target", EXTRAS)
def test_an_image_runs_without_rights_without_tools_to_build_with_and_with_what_its_bill_says(
    podman: Podman, target: str
) -> None:
    python = "/opt/fleetsight/bin/python3"
    found = json.loads(podman.once(f"localhost/fleetsight-{target}", "-c", LOOK, entry=python))
    assert (found["user"], found["tools"]) == (10001, "")
    assert found["version"] == f"fleetsight {version('fleetsight')}\n"
    packages = {canonicalize_name(name): release for name, release in found["packages"].items()}
    assert packages == needed(EXTRAS[target] or ())


@pytest.mark.parametrize("target", [*EXTRAS, *PEERS])
def test_the_bill_of_an_image_has_debian_s_packages(
    podman: Podman, monkeypatch: pytest.MonkeyPatch, target: str
) -> None:
    for name, value in podman.environment.items():
        monkeypatch.setenv(name, value)
    image = f"localhost/fleetsight-{target}"
    found = find_image(image, version("fleetsight"), REVISION)
    assert found is not None
    kept = podman.once(image, "/var/lib/dpkg/status", entry="cat")
    entries = [each for each in kept.split("\n\n") if "\nStatus: install ok installed\n" in each]
    installed = [each.splitlines()[0].removeprefix("Package: ") for each in entries]
    listed = found.debian_packages()
    assert [each.name for each in listed] == sorted(installed)
    assert {"libc6", "python3" if target in EXTRAS else target} <= set(installed)
    libc = next(each for each in listed if each.name == "libc6").to_string()
    assert re.fullmatch(r"pkg:deb/debian/libc6@2\.36-\S+\?arch=\w+&distro=debian-12&upstream=glibc", libc)


@pytest.mark.parametrize("target", [*EXTRAS, *PEERS])
def test_an_image_says_what_it_is_and_is_no_root_s(podman: Podman, target: str) -> None:
    (described,) = json.loads(podman.run("inspect", f"localhost/fleetsight-{target}"))
    assert described["Config"]["User"] == "10001:10001"
    labels = {name.rpartition(".")[2]: value for name, value in described["Config"]["Labels"].items()}
    assert (labels["version"], labels["revision"]) == (version("fleetsight"), REVISION)
    assert labels["title"] == ("fleetsight" if target in EXTRAS else f"fleetsight-{target}")
    assert labels["description"]
    assert labels.get("licenses") == ("AGPL-3.0-or-later" if target in EXTRAS else None)


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
    master = free_ports(3)
    port, listened = master + 1, master + 2
    gateway = ("gateway", "--robot=r1", f"--ros-master=http://127.0.0.1:{master}", f"--connect=tcp/127.0.0.1:{port}")
    with simulator(f"--master-port={master}") as robot, seeing(f"tcp/127.0.0.1:{port}") as router:
        try:
            with old.running(image, *gateway, f"--listen=tcp/127.0.0.1:{listened}"):
                assert router.stdout is not None
                assert router.stdout.readline() == "r1 640 480\n"
        finally:
            robot.terminate()
            router.kill()


@pytest.fixture(scope="module")
def fleet(podman: Podman) -> Iterator[Podman]:
    podman.compose(*SIMULATED, "up", "--detach", "--no-build")
    yield podman
    podman.compose(*SIMULATED, "down", "--volumes")


def test_a_simulated_robot_s_data_reaches_the_centre(fleet: Podman) -> None:
    fleet.until_said("deploy_monitor_1", "r1/camera: online")
    fleet.until_said("deploy_distance_1", "serving 1 cameras")
    fleet.until_said("deploy_worldmodel_1", "serving it")
    told = fleet.run("exec", "deploy_gateway_1", "fleetsight", "doctor", "--connect", "tcp/monitor:7447")
    assert "r1: its gateway" in told


def test_the_demo_s_check_passes(fleet: Podman) -> None:
    """Every robot was seen, by class lists of the detector."""
    check = Path(__file__).parent.joinpath("support", "demo_check.py").read_text(encoding="utf-8")
    told = fleet.run("exec", "deploy_monitor_1", "python3", "-c", check, "tcp/monitor:7447", "r1")
    assert re.search(r"^class lists received: [1-9]\d* \(r1 [1-9]", told, re.MULTILINE)
    assert told.endswith("result:               every robot was seen\n")


def test_a_program_where_the_gateway_alone_is_installed_gets_what_the_detector_sees(fleet: Podman) -> None:
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


@pytest.mark.parametrize("name", STARTED)
def test_each_process_is_healthy(fleet: Podman, name: str) -> None:
    end = time.monotonic() + DEADLINE_S
    while not fleet.is_healthy(f"deploy_{name}_1"):
        assert time.monotonic() < end, fleet.logs(f"deploy_{name}_1")
        time.sleep(0.5)


@pytest.mark.parametrize("name", ["distance", "monitor", "prometheus"])
def test_a_process_that_hangs_is_unhealthy_until_it_goes_on(fleet: Podman, name: str) -> None:
    """Of a process whose event loop turns the heartbeat is touched again within 5 s, of one that hangs it is not."""
    old = "import os; os.utime(os.environ['FLEETSIGHT_HEARTBEAT_FILE'], (0, 0))"
    fleet.run("kill", "--signal=STOP", f"deploy_{name}_1")
    if name == "distance":
        fleet.run("exec", f"deploy_{name}_1", "python3", "-c", old)
        time.sleep(6)
    assert not fleet.is_healthy(f"deploy_{name}_1")
    fleet.run("kill", "--signal=CONT", f"deploy_{name}_1")
    test_each_process_is_healthy(fleet, name)


def test_the_history_is_in_postgresql(fleet: Podman) -> None:
    count = ["sh", "-c", 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -Atc "table presence"']
    end = time.monotonic() + DEADLINE_S
    while "r1||" not in (rows := fleet.run("exec", "deploy_postgresql_1", *count)):
        assert time.monotonic() < end, rows
        time.sleep(0.5)


def test_the_history_is_backed_up_while_the_monitor_writes_and_restored_elsewhere(fleet: Podman) -> None:
    """Into another database of the same server, whose name takes the place of the first one's in the monitor's URL."""
    sql = 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -c "create database restored"'
    fleet.run("exec", "deploy_postgresql_1", "sh", "-c", sql)
    steps = (
        "fleetsight history backup --to /tmp/copy && "
        'FLEETSIGHT_HISTORY="${FLEETSIGHT_HISTORY%postgres}restored" fleetsight history restore --from /tmp/copy'
    )
    told = fleet.run("exec", "deploy_monitor_1", "sh", "-c", steps)
    assert re.search(r"^/tmp/copy: [\d.]+ MB\n.*restored: [1-9]\d* intervals$", told, re.MULTILINE)


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
    count = 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -Atc "select count(*) from presence"'
    before = int(fleet.run("exec", "deploy_postgresql_1", "sh", "-c", count))
    fleet.run("kill", "--signal=KILL", "deploy_monitor_1")
    killed = datetime.now(UTC).isoformat(timespec="seconds")
    fleet.run("start", "deploy_monitor_1")
    fleet.until_said("deploy_monitor_1", "r1/camera: online", f"--since={killed}")
    assert int(fleet.run("exec", "deploy_postgresql_1", "sh", "-c", count)) >= before > 0


def test_all_end_in_order(fleet: Podman) -> None:
    for name in reversed(STARTED):
        fleet.run("stop", "--time=10", f"deploy_{name}_1")
        (described,) = json.loads(fleet.run("inspect", f"deploy_{name}_1"))
        assert (name, described["State"]["ExitCode"]) == (name, 0)


@pytest.fixture
def central(podman: Podman, tmp_path: Path) -> Iterator[Podman]:
    """What is central for real robots, with certificates of `fleetsight pki`."""
    make_central(tmp_path)
    files = ["--project-name=central", "--file", str(DEPLOY / "compose.robots.yaml")]
    folder = {"FLEETSIGHT_TLS_FOLDER": str(tmp_path), "FLEETSIGHT_DB_PASSWORD": "seven7lights"}
    try:
        podman.compose(*files, "up", "--detach", "--no-build", **folder)
        yield podman
    finally:
        podman.compose(*files, "down", "--volumes", **folder)


def test_real_robots_are_served_over_links_with_certificates_and_others_are_not(
    central: Podman, tmp_path: Path
) -> None:
    """The robot is on the host's network, as another machine is: its link goes through the port that is published."""
    confined = ["--detach", "--pull=never", "--read-only", "--cap-drop=all", "--network=host"]
    simulator = ["localhost/fleetsight-simulator", "simulate", "--robots=1", "--master-port=11399"]
    gateway = ["localhost/fleetsight-gateway", "gateway", "--ros-master=http://127.0.0.1:11399"]
    gateway += ["--connect=tls/127.0.0.1:7447", "--tls=/tls/r1"]
    try:
        central.run("run", *confined, "--name=robot", *simulator)
        for name in (ROBOT, STRANGER):
            central.run(
                "run", *confined, f"--volume={tmp_path}/{name}:/tls:ro", f"--name={name}", *gateway, f"--robot={name}"
            )
        for name in ("detector", "distance", "cloud"):
            central.until_said(f"central_{name}_1", "serving 1 cameras")
        central.until_said("central_worldmodel_1", "serving it")
        central.until_said("central_monitor_1", "r1/camera: online")
        central.until_said(STRANGER, "waiting for a link to tls/127.0.0.1:7447")
        assert "connected to" in central.logs(ROBOT)
        assert "connected to" not in central.logs(STRANGER)
        assert f"{STRANGER}/camera" not in central.logs("central_monitor_1")
    finally:
        central.run("rm", "--force", "--time=5", "robot", "r1", STRANGER)


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
        gateway = ["gateway", f"--robot={ROBOT}", f"--connect=tls/{NAME}-monitor:7447", "--tls=/tls/r1"]
        beside = ["--network=container:robot", f"--volume={tmp_path}/robot:/tls:ro", "localhost/fleetsight-gateway"]
        podman.run(*joined, "--name=gateway", *beside, *gateway)
        podman.until_said(pod("monitor"), "r1/camera: online")
        podman.until_said(pod("distance"), "serving 1 cameras")
        podman.until_said(pod("worldmodel"), "serving it")
        present = 'PGPASSWORD=$PASSWORD psql -h 127.0.0.1 -U fleetsight -d postgres -Atc "table presence"'
        end = time.monotonic() + DEADLINE_S
        while "r1||" not in (rows := podman.run("exec", "database", "sh", "-c", present)):
            assert time.monotonic() < end, rows
            time.sleep(0.5)
        add = (
            "echo a-long-password | fleetsight users add alice --role viewer >/dev/null && fleetsight users token alice"
        )
        token = podman.run("exec", pod("monitor"), "sh", "-c", add).split()[-1]
        assert ask(podman, pod("distance"), "/healthz")[0] == '{"status":"ok"}', (
            "links are open to all, or something is wrong"
        )
        assert ask(podman, pod("distance"), "/metrics")[1] == "401"
        end = time.monotonic() + DEADLINE_S
        while (answer := ask(podman, pod("distance"), "/metrics", f"Authorization: Bearer {token}"))[1] != "200":
            assert time.monotonic() < end, answer  # a running monitor knows new users within seconds
            time.sleep(0.5)
        assert 'fleetsight_robot_online{robot="r1"} 1.0' in answer[0]


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
    podman.until_said(pod("monitor"), "r1/camera: online")
    podman.until_said(pod("distance"), "serving 1 cameras")
    podman.until_said(pod("cloud"), "serving 1 cameras")
    podman.until_said(pod("worldmodel"), "serving it")
    podman.until_said(pod("detector"), "serving 1 cameras")
    read = "import urllib.request as web; print(web.urlopen('http://{}-monitor:8080{}', timeout=9).read().decode())"
    containers = {each["containers"][0]["name"]: each["containers"][0] for each in pods}
    probes = {name: container["livenessProbe"] for name, container in containers.items()}
    assert probes.keys() == {"monitor", "detector", "distance", "cloud", "worldmodel"}
    for name, probe in probes.items():
        if name == "monitor":
            answer = podman.run("exec", pod("cloud"), "python3", "-c", read.format(NAME, probe["httpGet"]["path"]))
            assert json.loads(answer)["status"] == "ok"
        else:
            podman.run("exec", pod(name), *probe["exec"]["command"])
            podman.until_passes(pod(name), *containers[name]["readinessProbe"]["exec"]["command"])
            *python, script = probe["exec"]["command"]
            hung = f"import os; os.utime('/tmp/heartbeat', (0, 0)); {script}"
            with pytest.raises(AssertionError):
                podman.run("exec", pod(name), *python, hung)
    metrics = podman.run("exec", pod("cloud"), "python3", "-c", read.format(NAME, "/metrics"))
    assert 'fleetsight_robot_online{robot="r1"} 1.0' in metrics
    assert set(re.findall(r'busy_seconds_total{service="(\w+)"', metrics)) == {"detector", "distance", "cloud"}
