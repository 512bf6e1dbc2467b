import os
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

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


HUB = """
import sys
from pathlib import Path
from services.detector.runtime.offline import keep_offline

keep_offline(Path(sys.argv[1]), download=sys.argv[3] == "download")
import torch
torch.hub.set_dir(sys.argv[1])
for fetch in (
    lambda: torch.hub.load_state_dict_from_url(sys.argv[2] + "/weights.pt"),
    lambda: torch.hub.download_url_to_file(sys.argv[2] + "/weights.pt", sys.argv[1] + "/weights.pt", progress=False),
):
    try:
        fetch()
    except Exception as error:
        print("failed:", error)
"""


@pytest.mark.parametrize("download", [False, True])
def test_torchs_hub_opens_no_address_unless_downloads_are_allowed(tmp_path: Path, *, download: bool) -> None:
    asked: list[str] = []

    class Weights(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Weights) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address, allowed = f"http://127.0.0.1:{server.server_port}", "download" if download else "not"
        program = [sys.executable, "-c", HUB, str(tmp_path), address, allowed]
        said = subprocess.run(program, check=True, capture_output=True, text=True).stdout.splitlines()
        server.shutdown()
    assert asked == ["/weights.pt"] * 2 * download
    why = "HTTP Error 404: Not Found" if download else "nothing is downloaded without --download"
    assert [line for line in said if line.startswith("failed:")] == [f"failed: {why}"] * 2
