"""The chart, rendered by real Helm."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from tests.deploy.support.units import DEPLOY
from tests.missing import require_debian

CHART: Final = DEPLOY / "helm" / "fleetsight"
RULES: Final = CHART / "files" / "rules.yaml"
HELM: Final = Path(sys.executable).parent / "helm"
NAME: Final = "demo-fleetsight"
"""What objects of a release called demo begin with."""

Values = Mapping[str, Any]


def helm(*command: str | Path, values: Values | None = None) -> "subprocess.CompletedProcess[str]":
    """Run Helm, with values in a file."""
    require_debian("Helm", [HELM], how="tests/install/helm.sh installs it")
    given = [] if values is None else ["--values", "-"]
    return subprocess.run(
        [HELM, *command, *given], input=yaml.safe_dump(values), capture_output=True, text=True, check=False
    )


def render(values: Values | None = None) -> list[dict[str, Any]]:
    """Return the objects of a release called demo."""
    done = helm("template", "demo", CHART, values=values or {})
    assert done.returncode == 0, done.stderr
    return [each for each in yaml.safe_load_all(done.stdout) if each]


def refusal(values: Values) -> str:
    """Return why Helm refuses values."""
    done = helm("template", "demo", CHART, values=values)
    assert done.returncode != 0
    return done.stderr


def find(objects: list[dict[str, Any]], kind: str, name: str) -> dict[str, Any]:
    """Return an object by kind, and by its name without the release's."""
    (found,) = (each for each in objects if (each["kind"], each["metadata"]["name"]) == (kind, f"{NAME}-{name}"))
    return found
