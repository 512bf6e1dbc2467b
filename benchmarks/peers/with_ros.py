"""Runs a peer with Debian's rospy beside the packages of this environment, which go first. Arguments: peer, its own.

Ultralytics is kept off the network as the detector keeps it.
"""

import runpy
import sys
import tempfile
from pathlib import Path
from typing import Final

from services.detector.runtime.offline import keep_offline

DEBIAN: Final = "/usr/lib/python3/dist-packages"

if __name__ == "__main__":
    sys.path.append(DEBIAN)
    del sys.argv[0]
    with tempfile.TemporaryDirectory() as folder:
        keep_offline(Path(folder), download=False)
        runpy.run_module(f"benchmarks.peers.{sys.argv[0]}", run_name="__main__", alter_sys=True)
