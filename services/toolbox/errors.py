"""What is wrong with how a command was called."""


class UsageError(Exception):
    """A setting that is wrong; the message names it and fits on one line."""
