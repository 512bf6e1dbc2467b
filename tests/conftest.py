from __future__ import annotations

import os

from hypothesis import settings

# No test asserts how long anything takes, on machines that do many things at once least of all.
settings.register_profile("fleetsight", deadline=None)
settings.load_profile("fleetsight")

# A test's monitor keeps no history unless the test says where.
os.environ.setdefault("FLEETSIGHT_HISTORY", "none")

# Zenoh has two receiving threads a process. What waits for a link holds one, and a test's sessions wait for each other.
os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 8))")
