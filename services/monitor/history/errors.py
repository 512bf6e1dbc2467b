"""HistoryError: the one error of the history, with a kind of it that no waiting mends."""


class HistoryError(Exception):
    """The database cannot be had, read or written; the message names the cause."""


class OtherVersionError(HistoryError):
    """The database's tables are those of another version."""
