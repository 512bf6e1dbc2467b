"""WebError: the one error of the web server."""


class WebError(Exception):
    """The web server cannot begin; the message names the cause."""
