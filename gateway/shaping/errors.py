"""ShapingError: the one error that scaling and compressing raise."""


class ShapingError(ValueError):
    """A frame that cannot be shaped as the settings say; the message names the cause."""
