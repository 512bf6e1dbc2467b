import argparse

import pytest

from benchmarks.arguments import at_least_one


def test_a_count_is_at_least_one() -> None:
    assert at_least_one("1") == 1
    with pytest.raises(argparse.ArgumentTypeError, match="0 is less than 1"):
        at_least_one("0")
