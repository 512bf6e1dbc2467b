"""WebError, the only error of the web server."""


class WebError(Exception):
    """The web server cannot start; the message names the cause."""
