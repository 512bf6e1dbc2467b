"""Every error this package raises on purpose.

BusError
└── BusClosedError
"""


class BusError(Exception):
    """The bus cannot do what was asked: a bad key, a refused endpoint, a declaration that failed."""


class BusClosedError(BusError):
    """The bus, or the publisher, subscription or watch used, has been closed."""
