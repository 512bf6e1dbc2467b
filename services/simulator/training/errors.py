"""What goes wrong in a training run."""


class TrainingError(Exception):
    """The run cannot go on; the message is one line for the user."""


def first_line(error: Exception) -> str:
    """Return what an error of another library says first, or its kind."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
