"""Makes text of others safe to print on a terminal. Pure."""


def printable(text: str) -> str:
    r"""Return text with every character that is not printed, such as ESC or a line's end, as its escape: `\x1b`."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in text)
