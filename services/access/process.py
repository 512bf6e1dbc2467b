"""`fleetsight pki` and `fleetsight access`."""

import asyncio
import gzip
import json
import logging
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from services.access.authority import Authority, AuthorityError
from services.access.enrolment_client import LAST_PART, EnrolmentError, Files, enrol, lines_of_enrolment, renew
from services.access.enrolment_protocol import PORT, Token, parse_address
from services.access.enrolment_server import EnrolmentServer
from services.access.fleet_file import FleetFile, FleetFileError, read_fleet
from services.access.invitations import Invitations
from services.access.rules import access_control
from services.access.settings import AccessSettings, PkiSettings, check_is_for
from services.option_names import read_secret, terminal_left_as_it_is

log = logging.getLogger(__name__)

DAY: Final = timedelta(days=1)
HOUR: Final = timedelta(hours=1)
MAX_TOKEN: Final = 512
ACCESS: Final = "access{}.json"
MOST_TOLD: Final = 5
SOON: Final = 14
"""Days before its end at which a certificate is marked; one that its machine renews, once that is overdue."""


class AccessError(Exception):
    """It cannot be done; the message says why, and what helps."""


async def run_pki(settings: PkiSettings) -> None:
    """Run the task and print what was done.

    Raises:
        AccessError: it cannot be done.
    """
    try:
        if settings.task == "serve":
            await _serve(Authority(settings.folder), settings)
            return
        asks = settings.task == "enrol"  # for the token, in a thread that an interrupt leaves waiting
        with terminal_left_as_it_is() if asks else nullcontext():
            lines = await asyncio.to_thread(lambda: list(_TASKS[settings.task](Authority(settings.folder), settings)))
    except (AuthorityError, EnrolmentError) as error:
        raise AccessError(str(error)) from error
    except OSError as error:
        raise AccessError(f"{error.filename}: {error.strerror}") from error
    sys.stdout.writelines(f"{line}\n" for line in lines)


def _init(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    fleet = None if settings.fleet is None else _read_fleet(settings.fleet)
    if fleet is not None and not authority.folder.exists():
        for name in fleet.names():
            authority.check_free(name)
    made = authority.make()
    yield f"{made}: the fleet's authority; its key stays in {authority.folder}"
    if fleet is not None and settings.fleet is not None:
        yield from _issue_all(authority, settings.fleet, fleet, settings.days)


def _issue(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    if settings.fleet is not None:
        yield from _issue_all(authority, settings.fleet, _read_fleet(settings.fleet), settings.days)
        return
    made = authority.issue(settings.name, settings.hosts, settings.days)
    yield f"{made}, {made.with_suffix('.key')}: for {settings.name}, good for {settings.days:g} days"


def _issue_all(authority: Authority, file: Path, fleet: FleetFile, days: float) -> Iterator[str]:
    """Make what the names of a fleet file lack, and the rules beside it."""
    there = {each.name for each in authority.all()} | fleet.denied_names()
    there |= {name for name, _ in Invitations(authority).pending(datetime.now(UTC))}
    names = [name for name in fleet.names() if name not in there]
    for name in names:
        authority.issue(name, (), days)
    if names:
        told = ", ".join(names[:MOST_TOLD]) + (", ..." if len(names) > MOST_TOLD else "")
        yield f"{authority.folder}/NAME.pem, NAME.key: {len(names)} new, good for {days:g} days: {told}"
    for warehouse in fleet.warehouses or ("",):
        access = file.with_name(ACCESS.format(f"-{warehouse}" if warehouse else ""))
        _write(access, _rules(fleet.at(warehouse), authority.folder))
        yield f"{access}: what each of them may do, for the routers{f' of {warehouse}' if warehouse else ''}"


def _list(authority: Authority, _: PkiSettings) -> Iterator[str]:
    for issued in authority.all():
        left = (issued.until - datetime.now(UTC)) / DAY
        soon = issued.days * LAST_PART if Invitations(authority).has_enrolled(issued.name) else SOON
        state = "revoked" if issued.revoked else "ended" if left <= 0 else "renew soon" if left < soon else "good"
        yield f"{issued.name:<24} {state:<10} {max(left, 0):6.1f} days  {' '.join(issued.hosts)}".rstrip()
    now = datetime.now(UTC)
    for name, until in Invitations(authority).pending(now):
        yield f"{name:<24} {'invited':<10} {(until - now) / HOUR:6.1f} hours"


def _renew(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    until = datetime.now(UTC) + timedelta(days=settings.within_days)
    names = (
        [settings.name]
        if settings.name
        else [
            each.name
            for each in authority.all()
            if each.until <= until and not each.revoked and not Invitations(authority).has_enrolled(each.name)
        ]
    )
    for name in names:
        yield f"{authority.renew(name, settings.days)}: renewed"
    if not names:
        yield f"none ends within {settings.within_days:g} days"


def _revoke(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    if Invitations(authority).withdraw(settings.name):
        yield f"{settings.name}: its invitation is withdrawn"
        if all(issued.name != settings.name for issued in authority.all()):
            return
    issued = authority.revoke(settings.name)
    yield f"{issued.name}: revoked; its certificate is good until {issued.until:%Y-%m-%d}, so routers must deny it:"
    yield f"fleetsight access fleet.yaml --folder {settings.folder} --to access.json"


def _invite(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    name, rules = settings.name, f"fleetsight access fleet.yaml --folder {settings.folder} --to access.json"
    fleet = None if settings.fleet is None else _read_fleet(settings.fleet)
    if fleet is not None and name in fleet.denied_names():
        raise AccessError(f"{name} is denied in {settings.fleet}: take it out of `denied`, or choose another name")
    until = datetime.now(UTC) + timedelta(hours=settings.hours)
    token = Invitations(authority).make(
        name, until=until, hosts=settings.hosts, days=settings.days, replace=settings.replace
    )
    at = settings.at or f"{socket.gethostname()}:{PORT}"
    yield f"On the machine of {name}, as the user that its services run as, until {until:%Y-%m-%d %H:%M} UTC:"
    yield f"fleetsight pki enrol --at {at}"
    yield "It asks for this token, or reads it from standard input or FLEETSIGHT_TOKEN:"
    yield str(token)
    if fleet is None:
        yield f"{name} may do what fleet.yaml says of it; where it is new there: {rules}"
    elif name not in fleet.names():
        yield f"{name} is not in {settings.fleet}: it will have a certificate and no rights, until it is there and"
        yield f"fleetsight access {settings.fleet} --folder {settings.folder} --to access.json"


def _enrol(_: Authority, settings: PkiSettings) -> Iterator[str]:
    at = settings.at or ""
    address = parse_address(at)
    if not settings.renew:
        token = _token_of(settings)
        files = Files(settings.into, token.name)
        yield from lines_of_enrolment(files, enrol(token, address, files), at)
        return
    files = Files(settings.into, settings.name)
    made = renew(settings.name, address, files, now=datetime.now(UTC))
    if made is None:
        yield f"{files.certificate}: nothing to do before the last third of its days"
    else:
        yield f"{files.certificate}: renewed, until {made.not_valid_after_utc:%Y-%m-%d %H:%M} UTC"


def _token_of(settings: PkiSettings) -> Token:
    """Return the token that was given, or that is asked for.

    Raises:
        AccessError: it is none, or for another name than the one that was given.
    """
    try:
        text = settings.token or read_secret("Token: ", MAX_TOKEN)
        if not text.strip():
            raise AccessError("enrol needs the token that `fleetsight pki invite r1` at the authority prints")
        token = Token.parse(text)
        check_is_for(settings.name, token)
    except ValueError as error:
        raise AccessError(str(error)) from error
    return token


async def _serve(authority: Authority, settings: PkiSettings) -> None:
    if settings.fleet is not None:
        await asyncio.to_thread(_read_fleet, settings.fleet)
    server = await asyncio.to_thread(EnrolmentServer, authority, settings.fleet)
    host, port = parse_address(settings.at or f"0.0.0.0:{PORT}")
    try:
        found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, _, _, _, address = found[0]
        listening = socket.create_server(address[:2], family=family, backlog=64)
    except OSError as error:
        raise AccessError(f"at {host}:{port}: {error.strerror}") from error
    with listening:
        listening.settimeout(0)
        log.info("machines may enrol at %s:%d", *listening.getsockname()[:2])
        await server.serve(listening)


_TASKS: Final[Mapping[str, Callable[[Authority, PkiSettings], Iterator[str]]]] = {
    "init": _init,
    "issue": _issue,
    "list": _list,
    "renew": _renew,
    "revoke": _revoke,
    "invite": _invite,
    "enrol": _enrol,
}


async def run_access(settings: AccessSettings) -> None:
    """Print or write the rules.

    Raises:
        AccessError: the file cannot be used, or the rules not be written.
    """
    try:
        text = await asyncio.to_thread(_rules_of, settings)
        if settings.to is None:
            sys.stdout.write(text)
        else:
            await asyncio.to_thread(_write, settings.to, text)
    except OSError as error:
        raise AccessError(f"{error.filename}: {error.strerror}") from error


def _rules_of(settings: AccessSettings) -> str:
    try:
        fleet = _read_fleet(settings.fleet).at(settings.warehouse)
    except ValueError as error:
        raise AccessError(f"{settings.fleet}: {error}") from error
    return _rules(fleet, settings.folder)


def _rules(fleet: FleetFile, folder: Path | None) -> str:
    """Return the rules as text. folder: of an authority whose revoked names are denied, too."""
    if folder is not None:
        fleet = _without_revoked(fleet, folder)
    return json.dumps(access_control(fleet), indent=1) + "\n"


def _read_fleet(file: Path) -> FleetFile:
    try:
        return read_fleet(file.read_text(encoding="utf-8"))
    except FleetFileError as error:
        raise AccessError(f"{file}, {error}") from error


def _without_revoked(fleet: FleetFile, folder: Path) -> FleetFile:
    try:
        revoked = {issued.name for issued in Authority(folder).all() if issued.revoked}
    except AuthorityError as error:
        raise AccessError(str(error)) from error
    known = set(fleet.names())
    return fleet.model_copy(update={"denied": [*fleet.denied, *sorted(revoked & known)]})


def _write(to: Path, text: str) -> None:
    """Replace the file once the new one is whole: a router may start at any moment."""
    new = to.with_name(f".{to.name}")
    content = text.encode()
    new.write_bytes(gzip.compress(content, mtime=0) if to.suffix == ".gz" else content)
    new.replace(to)
