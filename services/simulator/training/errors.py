"""What goes wrong in a training run."""


class TrainingError(Exception):
    """The run cannot go on; the message is one line for the user."""
