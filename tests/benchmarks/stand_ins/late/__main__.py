"""A benchmark that never ends, nor does what it started."""

import signal
import subprocess
import sys

signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
sys.stderr.write(f"started {child.pid}\n")
child.wait()
