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
    "the gateway": "import gateway.process, services.toolbox.command_line",
    "the gateway's help": "import gateway.settings, services.toolbox.settings",
    "the detector's help": "import services.detector.settings, services.toolbox.settings",
}


NO_TORCH = (
    "torch",
    "ultralytics",
    "pycocotools",
    "matplotlib",
    "scipy",
    "rich",
    "open3d",
    "services.detector",
    "gateway",
)
WITHOUT_TORCH = {
    "the distance service": "import services.distance.process, services.toolbox.command_line",
    "the cloud service": "import services.cloud.process, services.toolbox.command_line",
}


def imported_by(statement: str) -> set[str]:
    program = f"{statement}\nimport sys\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )


CONSOLE = ("fleetsight.__main__", "services.toolbox.__main__")


@pytest.mark.parametrize("statement", STARTS.values(), ids=STARTS)
def test_heavy_imports_stay_out(statement: str) -> None:
    found = imported_by(statement)
    assert found
    heavy = [name for name in HEAVY if name in found and not (name == "services.detector" and "detector" in statement)]
    assert not heavy


@pytest.mark.parametrize("statement", WITHOUT_TORCH.values(), ids=WITHOUT_TORCH)
def test_what_measures_needs_no_torch(statement: str) -> None:
    found = imported_by(statement)
    assert "services.geometry.masks" in found
    assert not [name for name in NO_TORCH if name in found]


def test_the_world_model_needs_neither_torch_nor_opencv() -> None:
    found = imported_by("import services.worldmodel.process, services.toolbox.command_line")
    assert "services.worldmodel.model" in found
    assert not {*NO_TORCH, "cv2"} & found


def test_a_program_against_the_fleet_loads_the_bus_and_the_contract_alone() -> None:
    found = imported_by("import fleetsight.api")
    assert {"bus", "schemas", "zenoh"} <= found
    assert not {*HEAVY, *NO_TORCH, "numpy", "services"} & found


def test_a_detector_can_still_say_how_ultralytics_is_to_behave() -> None:
    assert not {"torch", "ultralytics", "onnxruntime", "openvino"} & imported_by("import services.detector.process")


@pytest.mark.parametrize("module", CONSOLE)
def test_the_console_command_can_be_interrupted_before_all_that_takes_a_while(module: str) -> None:
    assert not {"pydantic", "msgspec", "asyncio"} & imported_by(f"import {module}")


def test_the_check_sees_what_is_imported() -> None:
    assert "cv2" in imported_by("import services.detector.pixels")
