"""What of Debian a test needs: where it is missing the test is skipped, but in CI, where it has to be, it fails."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import pytest


def require_debian(what: str, paths: Iterable[str | Path], *, how: str) -> None:
    """Skip the test, or fail it in CI, where one of `paths` is not there. how: what installs `what`."""
    lacking = [str(path) for path in paths if not Path(path).exists()]
    if lacking:
        missing(f"{what} is missing ({', '.join(lacking)}); {how}")


def missing(why: str) -> NoReturn:
    """Skip the test, or fail it in CI. why: names what is missing and the cure."""
    (pytest.fail if os.environ.get("CI") else pytest.skip)(why)
