"""Every error that fleetsight raises on purpose. Each text names the thing, the cause and the cure.

FleetsightError
├── SettingsError        an endpoint, a name, a pattern or a number that is not valid
├── CertificateError     a file of certificates that cannot be used
├── ConnectError         no link in time, or none at the moment
├── ClosedError          the fleet was left, with `async with`, before
├── NoWorkerError        no detector worker is there to answer
├── NoMonitorError       no monitor is there to answer
├── NoWorldModelError    no world model keeps the site that was asked for
├── AnswerTimeoutError   no answer in time
├── RefusedError         the worker or monitor that was asked answers with an error
├── MessageError         a message that breaks the contract
└── SchemaError          a message or a key that cannot be made of what it is given
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from bus import BusClosedError, BusError, NotServedError, RequestTimeoutError
from bus import RefusedError as RefusedByServer
from schemas.errors import FleetsightError, SchemaError

__all__ = [
    "AnswerTimeoutError",
    "CertificateError",
    "ClosedError",
    "ConnectError",
    "FleetsightError",
    "MessageError",
    "NoMonitorError",
    "NoWorkerError",
    "NoWorldModelError",
    "RefusedError",
    "SchemaError",
    "SettingsError",
    "no_link",
    "translated",
]

LINK_CURE: Final = "wait until `fleet.problem` is empty, and see that the router runs"


class SettingsError(FleetsightError):
    """An endpoint, a name, a pattern or a number that is not valid."""


class CertificateError(FleetsightError):
    """A file of certificates cannot be used: it is absent, no PEM file, or has the key of another certificate."""


class ConnectError(FleetsightError):
    """There was no link in time, there is none at the moment, or an endpoint to listen on is taken."""


class ClosedError(FleetsightError):
    """The fleet was left before: `async with fleetsight.connect()` has ended."""


class NoWorkerError(FleetsightError):
    """No detector worker is there to answer."""


class NoMonitorError(FleetsightError):
    """No monitor is there to answer."""


class NoWorldModelError(FleetsightError):
    """No world model keeps the site that was asked for."""


class AnswerTimeoutError(FleetsightError):
    """No answer came in time."""


class RefusedError(FleetsightError):
    """The worker or monitor that was asked answers with an error, such as that a file is no image."""


class MessageError(FleetsightError):
    """A message breaks the contract: its sender is of another version, or is mistaken."""


@contextmanager
def translated(
    what: str,
    *,
    absent: type[FleetsightError] = FleetsightError,
    cure: str = "",
    link_problem: Callable[[], str] = str,
) -> Iterator[None]:
    """Raise errors of the bus and of the contract as ours.

    what: is done. absent: the error, and `cure` the remedy, where nobody answers. link_problem: returns why there is no
    link, which is then the cause of a missing answer, or an empty text.
    """
    try:
        with _without_link(what, link_problem):
            yield
    except BusClosedError as error:
        raise ClosedError(f"{what}: the fleet was left before; do it within `async with`") from error
    except NotServedError as error:
        raise absent(f"{what}: {error}; {cure}") from error
    except RequestTimeoutError as error:
        raise AnswerTimeoutError(f"{what}: {error}; give it more time") from error
    except RefusedByServer as error:
        raise RefusedError(f"{what}: {error}") from error
    except BusError as error:
        raise FleetsightError(f"{what}: {error}") from error
    except SchemaError as error:
        raise MessageError(f"{what}: {error}") from error


@contextmanager
def _without_link(what: str, link_problem: Callable[[], str]) -> Iterator[None]:
    try:
        yield
    except (NotServedError, RequestTimeoutError) as error:
        if problem := link_problem():
            raise no_link(what, problem) from error
        raise


def no_link(what: str, problem: str) -> ConnectError:
    """Return the error for something that takes a link while there is none. problem: why."""
    return ConnectError(f"{what}: {problem}; {LINK_CURE}")
