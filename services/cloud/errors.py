"""The one error of this package's pure parts."""


class CloudError(Exception):
    """Points that cannot be used; the message is one line and says why."""
