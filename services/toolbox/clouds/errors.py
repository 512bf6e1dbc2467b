"""Why clouds cannot be shown or saved."""


class ViewerError(Exception):
    """No window can be opened here, or no file written; the message is one line and says why."""
