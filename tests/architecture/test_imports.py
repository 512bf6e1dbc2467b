"""Heavy libraries stay out of light processes, whoever imports what in between."""

import subprocess
import sys

import pytest

HEAVY = (
    "torch",
    "ultralytics",
    "cv2",
    "rich",
    "pycocotools",
    "matplotlib",
    "polars",
    "sqlalchemy",
    "asyncpg",
    "httpx",
    "services.detector",
)
STARTS = {
    "the gateway": "import gateway.process, services.toolbox.__main__",
    "the gateway's help": "import gateway.settings, services.toolbox.settings",
    "the detector's help": "import services.detector.settings, services.toolbox.settings",
}


def imported_by(statement: str) -> set[str]:
    program = f"{statement}\nimport sys\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )


@pytest.mark.parametrize("statement", STARTS.values(), ids=STARTS)
def test_heavy_imports_stay_out(statement: str) -> None:
    found = imported_by(statement)
    assert found
    heavy = [name for name in HEAVY if name in found and not (name == "services.detector" and "detector" in statement)]
    assert not heavy


def test_the_check_sees_what_is_imported() -> None:
    assert "cv2" in imported_by("import services.detector.pixels")
