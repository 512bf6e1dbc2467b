from __future__ import annotations

from hypothesis import settings

# No test asserts how long anything takes, on machines that do many things at once least of all.
settings.register_profile("fleetsight", deadline=None)
settings.load_profile("fleetsight")
