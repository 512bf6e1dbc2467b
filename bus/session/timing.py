"""How long a session is waited for, and when another one follows it."""

from typing import Final

RETRY_S: Final = 0.5
"""Between attempts, and up to as long again: a fleet does not try in step."""


BRIEF_S: Final = 5.0
"""A session that lived no longer is followed by another one only after RETRY_S."""


REST_S: Final = 0.2
"""How long nothing follows the end of a session.

Letting go of one holds the interpreter lock until a thread of Zenoh's has time, which may wait for that lock itself to
call back (1.10), for ten seconds. By then nothing calls back any more.
"""


SETTLING_S: Final = 1.0
"""Longest wait for that; short of the deadline for closing."""


LOOK_S: Final = 0.1
"""How often it is looked meanwhile whether there is still anything to wait for."""
