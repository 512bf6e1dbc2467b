"""What benchmarks take on their command lines."""

import argparse


def at_least_one(text: str) -> int:
    """Read a count.

    Raises:
        argparse.ArgumentTypeError: it is less than 1.
    """
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return count
