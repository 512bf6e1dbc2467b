"""The demo and its processes where a workspace of somebody else was sourced."""

import subprocess
from pathlib import Path

import pytest

from tests.fleetsight.workspaces import DECOY, decoys, install, sourced

PATIENCE_S = 120


@pytest.mark.timeout(180)
def test_the_demo_runs_in_a_workspace_whose_packages_are_called_like_ours(tmp_path: Path) -> None:
    command, workspace = install(tmp_path / "installed"), decoys(tmp_path / "workspace")
    ended = subprocess.run(
        [command, "demo", "--robots", "1", "--seconds", "30"],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
        cwd=workspace,
        env=sourced(workspace),
    )
    assert ended.returncode == 0, ended.stderr
    assert DECOY not in ended.stderr
    assert ended.stdout.endswith("every robot was seen\n")
