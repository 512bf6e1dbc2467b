"""Every error that fleetsight raises on purpose. Each text names the thing, the cause and the cure.

FleetsightError
├── SettingsError        an endpoint, a name, a pattern or a number that cannot be
├── CertificateError     a file of certificates that cannot be used
├── ConnectError         no link in time
├── ClosedError          the fleet was left, with `async with`, before
├── NoWorkerError        no detector worker is there to answer
├── NoMonitorError       no monitor is there to answer
├── AnswerTimeoutError   no answer in time
├── RefusedError         the worker or monitor that was asked answers with an error
└── MessageError         a message that breaks the contract
"""

from collections.abc import Iterator
from contextlib import contextmanager

from bus import BusClosedError, BusError, NotServedError, RequestTimeoutError
from bus import RefusedError as RefusedByServer
from schemas.errors import SchemaError


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


class SettingsError(FleetsightError):
    """An endpoint, a name, a pattern or a number that cannot be."""


class CertificateError(FleetsightError):
    """A file of certificates cannot be used: it is absent, no PEM file, or has the key of another certificate."""


class ConnectError(FleetsightError):
    """There was no link in time, or an endpoint to listen on is taken."""


class ClosedError(FleetsightError):
    """The fleet was left before: `async with fleetsight.connect()` has ended."""


class NoWorkerError(FleetsightError):
    """No detector worker is there to answer."""


class NoMonitorError(FleetsightError):
    """No monitor is there to answer."""


class AnswerTimeoutError(FleetsightError):
    """No answer came in time."""


class RefusedError(FleetsightError):
    """The worker or monitor that was asked answers with an error, such as that a file is no image."""


class MessageError(FleetsightError):
    """A message breaks the contract: its sender is of another version, or is mistaken."""


@contextmanager
def translated(
    what: str, *, absent: type[FleetsightError] = FleetsightError, cure: str = "", late: str = "give it more time"
) -> Iterator[None]:
    """Raise errors of the bus and of the contract as ours.

    what: is done. absent: the error, and `cure` what helps, where nobody answers. late: what helps where nobody does in
    time.
    """
    try:
        yield
    except BusClosedError as error:
        raise ClosedError(f"{what}: the fleet was left before; do it within `async with`") from error
    except NotServedError as error:
        raise absent(f"{what}: {error}; {cure}") from error
    except RequestTimeoutError as error:
        raise AnswerTimeoutError(f"{what}: {error}; {late}") from error
    except RefusedByServer as error:
        raise RefusedError(f"{what}: {error}") from error
    except BusError as error:
        raise FleetsightError(f"{what}: {error}") from error
    except SchemaError as error:
        raise MessageError(f"{what}: {error}") from error
