import os
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import pytest

from services.toolbox import process


def spawn(body: str, *, finite: bool = False) -> subprocess.Popen[str]:
    """Start a process that runs `main`, defined by `body`, and says when it is ready for signals.

    A terminal that is closed tells it to stop, also where the tests themselves are to outlive theirs (nohup).
    """
    program = "import asyncio, signal, time\nfrom services.toolbox import process\n"
    program += "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n" + textwrap.dedent(body)
    end = f"\nprocess.leave(process.run(main, finite={finite}))"
    return subprocess.Popen([sys.executable, "-c", program + end], stdout=subprocess.PIPE, text=True)


PATIENT = """
    async def main():
        try:
            print("ready", flush=True)
            await asyncio.sleep(60)
        finally:
            print("cleaned up", flush=True)
"""
SLOW = """
    async def main():
        try:
            print("ready", flush=True)
            await asyncio.sleep(60)
        finally:
            await asyncio.sleep(0.3)
            print("cleaned up", flush=True)
"""
STUBBORN = """
    async def main():
        print("ready", flush=True)
        while True:
            try:
                await asyncio.sleep(60)
            except asyncio.CancelledError:
                pass
"""


THREADED = """
    async def main():
        print("ready", flush=True)
        try:
            await asyncio.to_thread(time.sleep, 60)
        finally:
            print("cleaned up", flush=True)
"""


@pytest.mark.parametrize("number", [*process.SIGNALS, signal.SIGHUP])
@pytest.mark.parametrize("body", [PATIENT, THREADED], ids=["itself", "whatever its threads do"])
def test_a_signal_ends_the_process_in_order(number: signal.Signals, body: str) -> None:
    with spawn(body) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        child.send_signal(number)
        assert child.stdout.read() == "cleaned up\n"
    assert child.returncode == 0


@pytest.mark.parametrize("number", [*process.SIGNALS, signal.SIGHUP])
def test_what_has_an_end_of_its_own_was_interrupted_before_it(number: signal.Signals) -> None:
    with spawn(PATIENT, finite=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(number)
        assert child.stdout.read() == "cleaned up\n"
    assert child.returncode == 128 + number


@pytest.mark.parametrize(("command", "code"), [("doctor", 130), ("monitor", 0)])
def test_so_was_what_is_interrupted_while_it_starts(command: str, code: int) -> None:
    starts = f"""
        import os, signal, sys
        from services.toolbox import __main__, stdio

        sys.argv[1:] = ["{command}"]
        stdio.prepare = lambda: os.kill(os.getpid(), signal.SIGINT)
        __main__.console()
    """
    assert subprocess.run([sys.executable, "-c", textwrap.dedent(starts)], check=False).returncode == code


def test_a_command_says_that_it_was_interrupted(tmp_path: Path) -> None:
    fleetsight = [sys.executable, "-m", "services.toolbox", "simulate", "--bag", str(tmp_path / "a.bag")]
    with subprocess.Popen([*fleetsight, "--robots", "1"], stderr=subprocess.DEVNULL) as child:
        while not any(tmp_path.iterdir()):
            time.sleep(0.05)
        child.send_signal(signal.SIGINT)
    assert child.returncode == 130


def test_who_told_it_to_outlive_the_terminal_has_it_outlive_the_terminal() -> None:
    with spawn("signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + textwrap.dedent(PATIENT)) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(signal.SIGHUP)
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.2)
        child.send_signal(signal.SIGTERM)
        assert child.stdout.read() == "cleaned up\n"
    assert child.returncode == 0


def test_a_process_that_does_not_end_is_left() -> None:
    with spawn(STUBBORN) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(signal.SIGTERM)
    assert child.returncode == process.EXIT_FAILED


def test_a_second_signal_does_not_wait() -> None:
    with spawn(STUBBORN) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(signal.SIGINT)
        time.sleep(0.2)
        child.send_signal(signal.SIGINT)
    assert child.returncode == process.EXIT_FAILED


def test_a_signal_that_arrives_twice_is_one() -> None:
    with spawn(SLOW) as child:
        assert child.stdout is not None
        child.stdout.readline()
        for _ in range(3):
            child.send_signal(signal.SIGTERM)
            time.sleep(0.02)
        assert child.stdout.read() == "cleaned up\n"
    assert child.returncode == 0


@pytest.mark.parametrize(("result", "code"), [(None, 0), (0, 0), (3, 3)])
def test_the_exit_code_is_what_main_returns(result: int | None, code: int) -> None:
    async def main() -> int | None:
        return result

    assert process.run(main) == code


def test_a_result_that_cannot_be_written_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def main() -> int:
        sys.stdout.write("found")
        return 0

    with suppress(OSError), Path("/dev/full").open("w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert process.run(main) == process.EXIT_FAILED
    assert capsys.readouterr().err == "fleetsight: the output cannot be written: No space left on device\n"


PRINTING = """
    import logging
    import signal
    import sys
    from services.toolbox import logs, process

    async def main():
        logs.configure("info")
        for _ in range(500):
            logging.getLogger("of somebody").info("x" * 200)
        for _ in range(7_000):
            print("123456789")

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    process.leave(process.run(main))
"""


def printing() -> subprocess.Popen[bytes]:
    """Start a process whose output is more than the system takes in unread."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", textwrap.dedent(PRINTING)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(2 * process.FLUSH_S)
    return child


def test_what_was_printed_arrives_whole_although_its_reader_pauses_and_nobody_reads_stderr() -> None:
    with printing() as child:
        assert child.stdout is not None
        assert len(child.stdout.read()) == 70_000
        assert child.wait() == 0


def test_who_waits_for_a_reader_is_interrupted_without_a_stack() -> None:
    with printing() as child:
        child.send_signal(signal.SIGINT)
        assert child.wait() == -signal.SIGINT
        assert child.stderr is not None
        assert b"Traceback" not in child.stderr.read()


def test_what_has_failed_has_failed_also_where_a_signal_comes_while_it_is_wound_up() -> None:
    failing = """
        async def main():
            def dawdle():
                print("ready", flush=True)
                time.sleep(2)
            asyncio.get_running_loop().run_in_executor(None, dawdle)
            await asyncio.sleep(0.2)
            raise ValueError("failed")
    """
    with spawn(failing) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(0.5)
        child.send_signal(signal.SIGTERM)
    assert child.returncode == process.EXIT_FAILED
