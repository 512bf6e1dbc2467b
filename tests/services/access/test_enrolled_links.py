"""A machine that has enrolled by the commands, and what it got opens real links."""

import asyncio
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from bus import QUEUE, BusSettings, QoS, open_bus
from bus.session import session
from services.access.enrolment_client import Files, renew
from services.access.enrolment_protocol import parse_address
from tests.bus.sessions import LEASE_S
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

FLEET = "robots: [r1..r9]\nroles: {central: monitor}\n"
PROGRAM = (sys.executable, "-m", "services.toolbox")


class Log:
    """The lines that a process writes to stderr."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.lines: list[str] = []
        self._process = process
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        self.lines.extend(iter(self._process.stderr.readline, ""))

    def wait_for(self, text: str) -> str:
        """Return the first line with a text."""
        end = time.monotonic() + 60
        while not (found := [line for line in self.lines if text in line]):
            assert time.monotonic() < end, self.lines
            time.sleep(0.02)
        return found[0]

    def close(self) -> None:
        self._reader.join()
        assert self._process.stderr is not None
        self._process.stderr.close()


def run(folder: Path, *arguments: str, code: int = 0, given: str = "") -> str:
    """Return what a command printed. given: on its standard input."""
    done = subprocess.run([*PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, check=False, input=given)
    assert done.returncode == code, done.stderr
    return done.stderr if code else done.stdout


@pytest.fixture
def central(tmp_path: Path) -> Path:
    folder = tmp_path / "central"
    folder.mkdir()
    (folder / "fleet.yaml").write_text(FLEET)
    for line in (
        "pki init",
        "pki issue central",
        "access fleet.yaml --folder pki --to access.json",
    ):
        run(folder, *line.split())
    return folder


@pytest.fixture
def server(central: Path) -> Iterator[Log]:
    command = [*PROGRAM, "pki", "serve", "--at", "127.0.0.1:0", "--fleet", "fleet.yaml"]
    with subprocess.Popen(command, cwd=central, stderr=subprocess.PIPE, text=True, env=os.environ) as process:
        log = Log(process)
        try:
            yield log
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0
            log.close()


async def test_from_an_invitation_to_a_link(
    central: Path, server: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(session, "LOOKED_AT_S", 0.1)
    caplog.set_level("INFO", "bus.session.session")
    at = server.wait_for("machines may enrol at").split()[-1]
    robot = tmp_path / "robot"
    robot.mkdir()
    said = run(central, "pki", "invite", "r4", "--at", at, "--fleet", "fleet.yaml", "--days", "7")
    assert "no rights" not in said
    printed = re.search(r"^fleetsight (pki enrol .*)$", said, re.MULTILINE)
    assert printed is not None
    token = said.splitlines()[3]
    assert token.startswith("r4:")
    assert token not in printed[1], "a command line is everybody's to see"
    told = run(robot, *shlex.split(printed[1]), given=f"{token}\n")
    assert f"tls: {robot}/tls/r4\n" in told
    assert "r4 enrolled from 127.0.0.1, for 7 days" in server.wait_for("r4 enrolled")
    again_at = (*shlex.split(printed[1]), "--into", "more")
    assert "the token was used at" in run(robot, *again_at, code=2, given=token)

    assert re.search(r"^r4 +good +7.0 days", run(central, "pki", "list"), re.MULTILINE)
    assert run(central, "pki", "renew") == "none ends within 30 days\n"  # it renews itself
    again = re.search(r"renew it once a day: fleetsight (.*)$", told, re.MULTILINE)
    assert again is not None
    assert "nothing to do before the last third" in run(robot, *shlex.split(again[1]))

    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    common = {"lease_s": LEASE_S, "shared_memory": False}
    listening = {"mode": "router", "listen": [endpoint], "access": central / "access.json"}
    async with (
        open_bus(BusSettings.model_validate({"tls": central / "pki/central", **listening, **common})) as centre,
        centre.subscribe("fleet/**", QUEUE(9)) as heard,
        open_bus(BusSettings.model_validate({"tls": robot / "tls/r4", "connect": [endpoint], **common})) as bus,
        bus.publisher("fleet/r4/text/hello", QoS.RESULT) as own,
        bus.publisher("fleet/r5/text/hello", QoS.RESULT) as foreign,
    ):
        await until(lambda: not bus.link_problem)
        foreign.put(b"as another robot")
        own.put(b"hello")
        sample = await next_of(heard)
        assert (sample.key, sample.payload) == ("fleet/r4/text/hello", b"hello")

        files, later = Files(robot / "tls", "r4"), datetime.now(UTC) + timedelta(days=6)
        assert await asyncio.to_thread(renew, "r4", parse_address(at), files, now=later) is not None
        await until(lambda: "opening a new session: certificates or access rules have changed" in caplog.text)
        async with bus.publisher("fleet/r4/text/hello", QoS.RESULT) as renewed:
            while heard.counts.received < 2:  # messages sent while there is no link are lost
                renewed.put(b"renewed")
                await asyncio.sleep(0.1)
        assert (await next_of(heard)).payload == b"renewed"


def test_an_invitation_says_where_rights_are_missing(central: Path) -> None:
    said = run(central, "pki", "invite", "cart", "--fleet", "fleet.yaml")
    assert "cart is not in fleet.yaml: it will have a certificate and no rights" in said
    (central / "fleet.yaml").write_text(f"{FLEET}denied: [r4]\n")
    assert "r4 is denied in fleet.yaml" in run(central, "pki", "invite", "r4", "--fleet", "fleet.yaml", code=2)


def test_an_invitation_alone_can_be_withdrawn(central: Path) -> None:
    run(central, "pki", "invite", "r4")
    assert "r4                       invited       1.0 hours\n" in run(central, "pki", "list")
    assert run(central, "pki", "revoke", "r4") == "r4: its invitation is withdrawn\n"
    assert "there is no certificate of r4" in run(central, "pki", "revoke", "r4", code=2)


def test_nobody_there_is_told(tmp_path: Path) -> None:
    endpoint = free_endpoint().removeprefix("tcp/")
    said = run(tmp_path, "pki", "enrol", "--at", endpoint, code=2, given="r4:x:y\n")
    assert said == (f"fleetsight pki: {endpoint}: Connection refused; is `fleetsight pki serve` running there?\n")
    assert not list((tmp_path / "tls").iterdir())


@pytest.mark.parametrize(
    ("options", "given", "reason"),
    [
        ((), "", "enrol needs the token that `fleetsight pki invite r1` at the authority prints"),
        ((), "\n", "enrol needs the token that `fleetsight pki invite r1` at the authority prints"),
        ((), "r4secret\n", "this is no token: copy all that `fleetsight pki invite` printed, name:secret:fingerprint"),
        (("r5",), "r4:secret:y\n", "the token is for r4, not for r5"),
    ],
)
def test_a_token_that_is_read_is_checked_and_not_shown(
    tmp_path: Path, options: tuple[str, ...], given: str, reason: str
) -> None:
    said = run(tmp_path, "pki", "enrol", *options, "--at", "127.0.0.1:1", code=2, given=given)
    assert said == f"fleetsight pki: {reason}\n"
    assert "secret" not in said.replace("name:secret:fingerprint", "")


def test_a_token_on_the_command_line_is_taken_and_said_to_be_seen_there(tmp_path: Path) -> None:
    endpoint = free_endpoint().removeprefix("tcp/")
    said = run(tmp_path, "pki", "enrol", "--at", endpoint, "--token", "r4:x:y", code=2)
    assert "--token holds a secret, which everybody on this machine can see in the list of processes" in said
    assert "Connection refused" in said


def test_a_token_is_asked_for_on_a_terminal_without_being_shown(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    try:
        command = [*PROGRAM, "pki", "enrol", "--at", free_endpoint().removeprefix("tcp/")]
        process = subprocess.Popen(
            command, cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
        )
        os.close(theirs)
        shown = b""
        while b"Token: " not in shown:
            shown += os.read(ours, 1024)
        os.write(ours, b"r4:hidden:y\n")
        with suppress(OSError):  # how a terminal says that nobody has it open
            while more := os.read(ours, 1024):
                shown += more
        assert process.wait(30) == 2
        assert b"Connection refused" in shown
        assert b"hidden" not in shown
    finally:
        os.close(ours)


def test_a_port_that_is_taken_is_told(central: Path, server: Log) -> None:
    at = server.wait_for("machines may enrol at").split()[-1]
    assert f"at {at}: Address already in use" in run(central, "pki", "serve", "--at", at, code=2)
