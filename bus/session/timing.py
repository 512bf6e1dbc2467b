"""Timing of the session: retries, rest before a new session, and deadlines."""

from typing import Final

RETRY_S: Final = 0.5
"""Delay between attempts, plus up to as much at random, so that a fleet does not retry in step."""


SHORT_SESSION_S: Final = 5.0
"""After a session that lived no longer than this, the next one waits for RETRY_S."""


REOPEN_PAUSE_S: Final = 0.2
"""Pause between the end of a session and the next one.

Releasing a session holds the interpreter lock until a Zenoh thread has time, which may wait for that lock itself to
call back (1.10), for ten seconds. After the pause no callbacks are left.
"""


SETTLING_S: Final = 1.0
"""Longest wait for a router to process declarations; shorter than the deadline for closing."""


POLL_S: Final = 0.1
"""Interval at which such a wait checks whether the session is ending."""
