"""The image for detectors on a GPU: several GB, so `make long` builds it, and `make test` does not.

Where there is no GPU it is started all the same, and runs on the processor.
"""

import asyncio
import json
import logging
import re
from collections.abc import Iterator
from importlib.metadata import version

import pytest
from packaging.utils import canonicalize_name

from bus import Subscription
from deploy.image_bill import find_image
from deploy.release import needed
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import Stream, camera_key
from services.toolbox.demo.children import child, free_ports
from tests.deploy.support.images import ALL_EXTRAS, LOOK, REVISION
from tests.deploy.support.machine import wheels
from tests.deploy.support.podman import Podman, podman_with_debian
from tests.deploy.support.units import DEPLOY
from tests.integration.fleet import fleet_rig

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

TARGET = "detector"
IMAGE = f"localhost/fleetsight-{TARGET}"
PYTHON = "/opt/fleetsight/bin/python3"
CONFINED = ("--read-only", "--tmpfs=/tmp", "--cap-drop=all", "--pull=never", "--network=host")
PATIENCE_S = 180
BUILD_S = 1800


@pytest.fixture(scope="module")
def podman(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Podman]:
    with podman_with_debian(tmp_path_factory, BUILD_S) as made:
        made.build_target(wheels(tmp_path_factory, ",".join(ALL_EXTRAS[TARGET])), REVISION, TARGET)
        yield made


def test_it_runs_without_rights_without_tools_to_build_with_and_with_what_its_bill_says(podman: Podman) -> None:
    found = json.loads(podman.once(IMAGE, "-c", LOOK, entry=PYTHON))
    assert (found["user"], found["tools"]) == (10001, "")
    assert found["version"] == f"fleetsight {version('fleetsight')}\n"
    packages = {canonicalize_name(name): release for name, release in found["packages"].items()}
    assert packages == needed(ALL_EXTRAS[TARGET])


def test_it_says_what_it_is_and_has_the_size_that_its_page_says(podman: Podman) -> None:
    (described,) = json.loads(podman.run("inspect", IMAGE))
    assert described["Config"]["User"] == "10001:10001"
    labels = {name.rpartition(".")[2]: value for name, value in described["Config"]["Labels"].items()}
    assert (labels["title"], labels["version"], labels["revision"]) == ("fleetsight", version("fleetsight"), REVISION)
    page = (DEPLOY.parent / "docs" / "containers.md").read_text(encoding="utf-8")
    told = re.search(r"^\| `detector` \| .*?([\d.]+) GB with CUDA", page, re.MULTILINE)
    assert told
    assert described["Size"] / 1e9 == pytest.approx(float(told[1]), rel=0.1)


def test_its_bill_has_debian_s_packages(podman: Podman, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in podman.environment.items():
        monkeypatch.setenv(name, value)
    found = find_image(IMAGE, version("fleetsight"), REVISION)
    assert found is not None
    assert {"libc6", "python3"} <= {each.name for each in found.debian_packages()}


def test_its_torch_has_cuda(podman: Podman) -> None:
    asked = "import torch; print(torch.version.cuda is not None, torch.backends.cudnn.version() is not None)"
    assert podman.once(IMAGE, "-c", asked, entry=PYTHON) == "True True\n"


def test_a_gpu_that_is_not_there_is_refused(podman: Podman) -> None:
    podman.run("run", "--detach", "--name=asked", *CONFINED, IMAGE, TARGET, "--device=cuda:99")
    assert podman.run("wait", "asked") == "2\n"
    assert "--device cuda:99: Invalid CUDA 'device=99' requested." in podman.logs("asked")


async def seen_in(lists: Subscription, podman: Podman, container: str) -> ClassList:
    """Return the next class list; fail with what the container wrote."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            sample = await anext(lists)
    except TimeoutError:
        pytest.fail(f"no class list came: {podman.logs(container)}")
    return codec.decode(ClassList, sample.payload, sample.encoding)


@pytest.mark.parametrize(("runtime", "model"), [("torch", "warehouse-n-seg.pt"), ("openvino", "warehouse-n-seg.onnx")])
async def test_its_detector_serves_a_camera(podman: Podman, runtime: str, model: str) -> None:
    port, name = free_ports(1), f"detector-{runtime}"
    simulator = ["simulate", "--robots=1", f"--master-port={port}", "--streams=color"]
    async with (
        fleet_rig() as rig,
        child("simulate", simulator, logging.getLogger(__name__).info),
        rig.subscribed(camera_key("r1", "camera").stream(Stream.CLASSES)) as lists,
    ):
        await rig.gateway("r1", f"http://127.0.0.1:{port}", {})
        started = (IMAGE, TARGET, f"--connect={rig.endpoint}", f"--runtime={runtime}")
        await asyncio.to_thread(podman.run, "run", "--detach", f"--name={name}", *CONFINED, *started)
        seen = await seen_in(lists, podman, name)
        while not any(each.count for each in seen.classes):
            seen = await seen_in(lists, podman, name)
        assert podman.is_healthy(name)
        await asyncio.to_thread(podman.run, "stop", "--time=10", name)
    assert (seen.header.robot, seen.model) == ("r1", model)
    (described,) = json.loads(podman.run("inspect", name))
    assert described["State"]["ExitCode"] == 0, podman.logs(name)
