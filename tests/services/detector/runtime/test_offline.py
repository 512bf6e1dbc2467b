import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
from pathlib import Path
from services.detector.runtime.offline import keep_offline

keep_offline(Path(sys.argv[1]), download=False)
import onnxruntime
from ultralytics.utils import ONLINE, SETTINGS
assert not ONLINE and not SETTINGS["sync"]
"""


def test_onnx_runtime_prepares_no_report(tmp_path: Path) -> None:
    """What it would send it collects in files of the user's own folders, from when it is imported."""
    own = tmp_path / "ultralytics"
    own.mkdir()
    homes = {name: str(tmp_path / "home") for name in ("HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME")}
    subprocess.run([sys.executable, "-c", PROGRAM, str(own)], check=True, env=os.environ | homes)
    assert not list((tmp_path / "home").rglob("*onnxruntime*"))
