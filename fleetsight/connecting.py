"""Join the fleet."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Final

from bus import Bus, BusError, BusSettings, open_bus
from bus.session.links import why_unreached
from fleetsight.arguments import number
from fleetsight.errors import CertificateError, ConnectError, FleetsightError, SettingsError
from fleetsight.fleet import Fleet
from fleetsight.settings import settings_of
from fleetsight.streams import Iterations

LINK_POLL_S: Final = 0.02
"""How often it is looked whether there is a link."""


@asynccontextmanager
async def connect(
    *endpoints: str,
    tls: str | Path | None = None,
    tls_ca: str | Path | None = None,
    tls_certificate: str | Path | None = None,
    tls_key: str | Path | None = None,
    settings: BusSettings | None = None,
    within_s: float = 10.0,
) -> AsyncIterator[Fleet]:
    """Join the fleet for as long as the context lasts; leaving it leaves no task, subscriber or thread behind.

    endpoints: Zenoh routers such as `tcp/central:7447`, of which the first that answers is used. Unless given,
    FLEETSIGHT_CONNECT names them, separated by commas, or else it is the monitor on this machine. tls: certificates for
    `tls/` endpoints as `fleetsight pki` makes them, `pki/ann` for pki/ca.pem, pki/ann.pem and pki/ann.key; or tls_ca,
    tls_certificate, tls_key, one by one; or FLEETSIGHT_TLS, FLEETSIGHT_TLS_CA and so on. Every other
    setting of the commands' links is read from the environment too, such as FLEETSIGHT_SCOUTING. settings: all of them
    at once, instead of arguments and environment. within_s: seconds to wait for a link.

    Raises:
        SettingsError: an endpoint, a variable or a time that is not valid.
        CertificateError: a file of certificates cannot be used.
        ConnectError: there is no link within `within_s` seconds; the message says why, as far as that is known.

    >>> async def main():
    ...     async with fleetsight.connect(endpoint) as fleet:
    ...         return await fleet.robots().present()
    >>> asyncio.run(main())
    frozenset({'r1'})
    """
    chosen = _chosen(
        endpoints, {"tls": tls, "tls_ca": tls_ca, "tls_certificate": tls_certificate, "tls_key": tls_key}, settings
    )
    within_s = number("within_s", within_s)
    iterations = Iterations()
    async with AsyncExitStack() as stack:
        stack.push_async_callback(iterations.ended)
        try:
            bus = await stack.enter_async_context(open_bus(chosen, own_process=False))
        except BusError as error:
            raise _refusal(error, chosen) from error
        stack.push_async_callback(iterations.end)
        await _linked(bus, chosen, within_s)
        yield Fleet(bus, iterations, chosen.tls_certificate)


def _chosen(
    endpoints: tuple[str, ...], files: dict[str, str | Path | None], settings: BusSettings | None
) -> BusSettings:
    given = {name: file for name, file in files.items() if file is not None}
    if settings is None:
        return settings_of({**({"connect": list(endpoints)} if endpoints else {}), **given})
    if endpoints or given:
        raise SettingsError("settings: endpoints or files are given beside them; put those into the settings")
    return settings


async def _linked(bus: Bus, settings: BusSettings, within_s: float) -> None:
    try:
        async with asyncio.timeout(within_s):
            while bus.link_problem:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(LINK_POLL_S)
    except TimeoutError as error:
        why = await asyncio.to_thread(why_unreached, settings.connect)
        cure = "start `fleetsight monitor` there, or name another endpoint"
        raise ConnectError(f"{bus.link_problem} after {within_s:g} s: {why}; {cure}") from error


def _refusal(error: BusError, settings: BusSettings) -> FleetsightError:
    if str(error).startswith("tls_"):
        return CertificateError(f"{error}; name another file")
    where = ", ".join([*settings.listen, *settings.connect])
    return ConnectError(f"{where}: {error}; name another endpoint")
