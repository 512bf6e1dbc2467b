"""Text of others, such as names of classes, as it may go to a terminal or a log. Pure."""


def printable(text: str) -> str:
    """Return a text on one line, without anything that moves a terminal's cursor or begins a line of a log."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in text)
