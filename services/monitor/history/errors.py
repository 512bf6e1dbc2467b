"""HistoryError, the only error of the history, and a permanent kind of it."""


class HistoryError(Exception):
    """The database cannot be opened, read or written; the message names the cause."""


class OtherVersionError(HistoryError):
    """The database's tables are those of another version."""
