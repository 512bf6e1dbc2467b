import json

import pytest

from gateway.doctor.process import UNWELL, run
from gateway.doctor.settings import DoctorSettings
from services.simulator.ros_master.master import RosMaster
from services.toolbox.settings import load
from tests.integration.peers.ros import free_port


def settings(*options: str) -> DoctorSettings:
    where = ["--ros-master", f"http://127.0.0.1:{free_port()}", "--connect", f"tcp/127.0.0.1:{free_port()}"]
    options = ("--robot", "r1", "--ros-host", "no-such-host.invalid", *where, *options)
    return load(DoctorSettings, options, prog="fleetsight doctor").settings


async def test_nothing_there_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert await run(settings()) == UNWELL
    shown = capsys.readouterr()
    assert shown.err == ""
    assert [line for line in shown.out.splitlines() if line[:1].isalpha()] == [
        "ROS master",
        "this machine",
        "gateway on the bus",
    ]
    assert shown.out.count("PROBLEM") == 3
    assert "\n3 problems; the first to solve: http://127.0.0.1:" in shown.out


async def test_without_a_robot_only_the_fleet_is_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--connect", f"tcp/127.0.0.1:{free_port()}", "--cameras", "front=/front", "--json"]
    assert await run(load(DoctorSettings, given, prog="fleetsight doctor").settings) == UNWELL
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert (finding["stage"], finding["what"]) == ("gateway on the bus", "no router listens there")


async def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert await run(settings("--json")) == UNWELL
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    assert [each["severity"] for each in report["findings"]] == ["problem"] * 3


async def test_what_is_asked_for_of_no_stream_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    async with RosMaster() as master:
        await run(settings("--ros-master", master.uri, "--max-hz", "fornt/color=5", "--json"))
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert ("note", "--max-hz fornt/color") in [(each["severity"], each["subject"]) for each in findings]
