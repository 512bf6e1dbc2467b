"""HistoryError: the one error of the history."""


class HistoryError(Exception):
    """The database cannot be had, read or written; the message names the cause."""
