import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy" / "venv.sh"

PYTHON = """\
#!/bin/sh
case "$1 $2" in
    "-m venv") mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
    "-m pip") printf fetched >"$TMPDIR/wheel" ;;
    --version*) echo Python 3; exit ;;
    *) exit ;;
esac
if [ "$2" = "$STALL" ]; then
    echo >"$STALLED"
    exec sleep 60
fi
"""
"""Stands in for Python; what `STALL` names takes long."""


class Checkout:
    def __init__(self, folder: Path) -> None:
        self.folder = folder / "a checkout"
        self.venv = self.folder / ".venv"
        self.scratch = folder / "tmp"
        self._stalled = folder / "stalled"
        (self.folder / "deploy").mkdir(parents=True)
        self.scratch.mkdir()
        os.mkfifo(self._stalled)
        shutil.copy(SCRIPT, self.folder / "deploy")
        self._python = folder / "python3"
        self._python.write_text(PYTHON, encoding="utf-8")
        self._python.chmod(0o755)

    def set_up(self, stall: str = "") -> subprocess.Popen[bytes]:
        words = {
            "PYTHON": str(self._python),
            "STALL": stall,
            "STALLED": str(self._stalled),
            "TMPDIR": str(self.scratch),
        }
        script = str(self.folder / "deploy" / "venv.sh")
        return subprocess.Popen([script, "all"], env=os.environ | words, start_new_session=True)

    def interrupted(self, while_doing: str) -> int:
        with self.set_up(while_doing) as running:
            self._stalled.read_bytes()
            os.killpg(running.pid, signal.SIGINT)
            return running.wait()


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


def test_set_up_leaves_nothing_but_the_environment(checkout: Checkout) -> None:
    with checkout.set_up() as running:
        assert running.wait() == 0
    assert {path.name for path in checkout.venv.iterdir()} == {"bin", ".all"}
    assert list(checkout.scratch.iterdir()) == []


def test_interrupted_while_it_installs_it_leaves_nothing_of_what_was_fetched(checkout: Checkout) -> None:
    assert checkout.interrupted("pip") == 130
    assert {path.name for path in checkout.venv.iterdir()} == {"bin"}
    assert list(checkout.scratch.iterdir()) == []


def test_interrupted_while_it_makes_the_environment_it_leaves_no_half_of_one(checkout: Checkout) -> None:
    assert checkout.interrupted("venv") == 130
    assert not checkout.venv.exists()
    assert list(checkout.scratch.iterdir()) == []
