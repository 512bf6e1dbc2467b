"""Errors of showing or saving clouds."""


class ViewerError(Exception):
    """A window cannot be opened here, or a file cannot be written; the message is one line and says why."""
