"""`fleetsight pki` and `fleetsight access`."""

import asyncio
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from services.access.authority import Authority, AuthorityError
from services.access.fleet_file import FleetFile, FleetFileError, read_fleet
from services.access.rules import access_control
from services.access.settings import AccessSettings, PkiSettings

DAY: Final = timedelta(days=1)
SOON: Final = 14
"""Days before its end at which a certificate is marked."""


class AccessError(Exception):
    """It cannot be done; the message says why, and what helps."""


async def run_pki(settings: PkiSettings) -> None:
    """Run the task and print what was done.

    Raises:
        AccessError: it cannot be done.
    """
    try:
        lines = await asyncio.to_thread(lambda: list(_TASKS[settings.task](Authority(settings.folder), settings)))
    except AuthorityError as error:
        raise AccessError(str(error)) from error
    except OSError as error:
        raise AccessError(f"{error.filename}: {error.strerror}") from error
    sys.stdout.writelines(f"{line}\n" for line in lines)


def _init(authority: Authority, _: PkiSettings) -> Iterator[str]:
    made = authority.make()
    yield f"{made}: the fleet's authority; its key stays in {authority.folder}"


def _issue(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    made = authority.issue(settings.name, settings.hosts, settings.days)
    yield f"{made}, {made.with_suffix('.key')}: for {settings.name}, good for {settings.days:g} days"


def _list(authority: Authority, _: PkiSettings) -> Iterator[str]:
    for issued in authority.all():
        left = (issued.until - datetime.now(UTC)) / DAY
        state = "revoked" if issued.revoked else "ended" if left <= 0 else "renew soon" if left < SOON else "good"
        yield f"{issued.name:<24} {state:<10} {max(left, 0):6.1f} days  {' '.join(issued.hosts)}".rstrip()


def _renew(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    until = datetime.now(UTC) + timedelta(days=settings.within_days)
    names = (
        [settings.name]
        if settings.name
        else [each.name for each in authority.all() if each.until <= until and not each.revoked]
    )
    for name in names:
        yield f"{authority.renew(name, settings.days)}: renewed"
    if not names:
        yield f"none ends within {settings.within_days:g} days"


def _revoke(authority: Authority, settings: PkiSettings) -> Iterator[str]:
    issued = authority.revoke(settings.name)
    yield f"{issued.name}: revoked; its certificate is good until {issued.until:%Y-%m-%d}, so routers must deny it:"
    yield f"fleetsight access fleet.yaml --folder {settings.folder} --to access.json"


_TASKS: Final[Mapping[str, Callable[[Authority, PkiSettings], Iterator[str]]]] = {
    "init": _init,
    "issue": _issue,
    "list": _list,
    "renew": _renew,
    "revoke": _revoke,
}


async def run_access(settings: AccessSettings) -> None:
    """Print or write the rules.

    Raises:
        AccessError: the file cannot be used, or the rules not be written.
    """
    try:
        text = await asyncio.to_thread(_rules, settings)
        if settings.to is None:
            sys.stdout.write(text)
        else:
            await asyncio.to_thread(_write, settings.to, text)
    except FleetFileError as error:
        raise AccessError(f"{settings.fleet}, {error}") from error
    except OSError as error:
        raise AccessError(f"{error.filename}: {error.strerror}") from error


def _rules(settings: AccessSettings) -> str:
    fleet = read_fleet(settings.fleet.read_text(encoding="utf-8"))
    if settings.folder is not None:
        fleet = _without_revoked(fleet, settings.folder)
    return json.dumps(access_control(fleet), indent=1) + "\n"


def _without_revoked(fleet: FleetFile, folder: Path) -> FleetFile:
    try:
        revoked = {issued.name for issued in Authority(folder).all() if issued.revoked}
    except AuthorityError as error:
        raise AccessError(str(error)) from error
    known = {*fleet.robot_names(), *fleet.roles}
    return fleet.model_copy(update={"denied": [*fleet.denied, *sorted(revoked & known)]})


def _write(to: Path, text: str) -> None:
    """Replace the file once the new one is whole: a router may start at any moment."""
    new = to.with_name(f".{to.name}")
    new.write_text(text, encoding="utf-8")
    new.replace(to)
