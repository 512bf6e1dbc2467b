"""Every message and service type that is spoken here, against Debian's genpy: md5sum, definition and bytes."""

from __future__ import annotations

import json
import subprocess
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from gateway.ros1.messages import deserialise, message_type, serialise, service_type
from gateway.ros1.msg.known_messages import DEFINITIONS, SERVICES
from tests.gateway import sensing
from tests.gateway.ros1.msg.building import built, meaning, plain
from tests.integration.peers.ros import PEERS, SYSTEM_PYTHON, require_ros

SCRIPT = PEERS / "genpy_codec.py"
EXAMPLES = 5


def drawn(name: str) -> list[bytes]:
    """Return messages of a type with all kinds of values."""
    found: list[bytes] = []

    @settings(max_examples=EXAMPLES, phases=[Phase.generate], deadline=None, suppress_health_check=list(HealthCheck))
    @given(plain(DEFINITIONS, name))
    def draw(value: Any) -> None:
        found.append(serialise(name, built(DEFINITIONS, name, value)))

    draw()
    return found


def genpy(lines: list[str]) -> list[dict[str, str]]:
    said = subprocess.run(
        [SYSTEM_PYTHON, str(SCRIPT)], input="\n".join(lines), capture_output=True, text=True, timeout=60, check=True
    )
    return [json.loads(line) for line in said.stdout.splitlines()]


@pytest.mark.usefixtures("ros_installed")
@pytest.mark.parametrize("package", sorted({name.partition("/")[0] for name in DEFINITIONS}))
def test_messages_are_those_of_genpy(package: str) -> None:
    require_ros(package)
    sent = [(name, data) for name in DEFINITIONS if name.startswith(f"{package}/") for data in drawn(name)]
    answers = genpy([f"{name} {data.hex()}" for name, data in sent])
    assert [answer["name"] for answer in answers] == [name for name, _ in sent]
    for (name, data), answer in zip(sent, answers, strict=True):
        theirs = bytes.fromhex(answer["data"])
        assert theirs == data
        assert serialise(name, deserialise(name, theirs)) == data
        assert answer["md5sum"] == message_type(name).md5sum
        if package != "std_srvs":  # a service's whole text is that of both its messages
            assert meaning(name, answer["definition"]) == meaning(name, message_type(name).definition)


@pytest.mark.usefixtures("ros_installed")
def test_texts_that_are_not_utf8_are_read_as_genpy_reads_them() -> None:
    require_ros("tf2_msgs", "sensor_msgs")
    sent = [
        (message.publisher.type.name, bytes(message.data).replace(b"K?ste", b"K\xe4ste"))
        for message in (
            sensing.tf(sensing.transform("lens"), sensing.transform("K?ste")),
            sensing.camera_info(header=sensing.ros_header("K?ste")),
            sensing.compressed("K?ste", b"file"),
            sensing.point_cloud(header=sensing.ros_header("K?ste")),
        )
    ]
    assert all(b"K\xe4ste" in data for _, data in sent)
    for (name, data), answer in zip(sent, genpy([f"{name} {data.hex()}" for name, data in sent]), strict=True):
        theirs = bytes.fromhex(answer["data"])
        assert "K\ufffdste".encode() in theirs
        assert serialise(name, deserialise(name, data)) == theirs


@pytest.mark.usefixtures("ros_installed")
def test_services_are_those_of_genpy() -> None:
    require_ros("std_srvs")
    for answer in genpy([f"{name} service" for name in sorted(SERVICES)]):
        assert answer["md5sum"] == service_type(answer["name"]).md5sum
