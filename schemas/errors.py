"""SchemaError: the one error that decoding, key parsing and message construction raise."""


class FleetsightError(Exception):
    """Base of all errors that fleetsight raises on purpose.

    >>> async def main():
    ...     async with fleetsight.connect("tcp/127.0.0.1:9", within_s=0.3):
    ...         pass
    >>> try:
    ...     asyncio.run(main())
    ... except fleetsight.FleetsightError as error:
    ...     print(type(error).__name__)
    ConnectError
    """


class SchemaError(FleetsightError, ValueError):
    """A payload, key or field that is not what the contract says; the message names the cause."""
