import argparse
import runpy
import sys

import pytest

from benchmarks.__main__ import HERE
from benchmarks.arguments import at_least_one
from benchmarks.running.finding import names_in


def test_a_count_is_at_least_one() -> None:
    assert at_least_one("1") == 1
    with pytest.raises(argparse.ArgumentTypeError, match="0 is less than 1"):
        at_least_one("0")


@pytest.mark.parametrize("name", names_in(HERE))
def test_every_benchmark_explains_itself(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.delitem(sys.modules, f"benchmarks.{name}.__main__", raising=False)  # another benchmark's
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: python -m benchmarks.{name}")
    assert "print one JSON object" in said
