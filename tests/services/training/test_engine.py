import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
from pathlib import Path
from services.training.trainer import load_ultralytics
load_ultralytics(Path(sys.argv[1]))
from ultralytics.data import base
print([step for step in base.TQDM(range(3), total=3, disable=False)])
"""


def test_ultralytics_shows_no_bars_of_its_own(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "ultralytics")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == "[0, 1, 2]\n"
    assert done.stderr == ""
