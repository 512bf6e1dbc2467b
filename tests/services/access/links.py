"""A router with access rules, and sessions of Zenoh's own with certificates, as any program might open them."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import zenoh

from bus.session.config import session_config
from bus.settings import BusSettings
from services.access.authority import Authority
from services.access.fleet_file import read_fleet
from services.access.rules import access_control
from tests.contract.conftest import free_endpoint

FLEET: Final = """
robots: [r1..r3]
roles:
  central: [monitor, worldmodel]
  gpu1: detector
  rack1: space
  world1: worldmodel
  central2: monitor
  ann: operator
  wall: observer
  berlin: warehouse
  second: router
denied: [r3]
"""
NAMES: Final = (
    "central",
    "second",
    "r1",
    "r2",
    "r3",
    "gpu1",
    "rack1",
    "world1",
    "central2",
    "ann",
    "wall",
    "berlin",
    "stranger",
)

PATIENCE_S: Final = 20.0
QUIET_S: Final = 0.25
"""What is let through has arrived by then, on a loopback link."""


def make_pki(folder: Path) -> Authority:
    """Make an authority and the certificates of a fleet."""
    authority = Authority(folder)
    authority.make()
    for name in NAMES:
        authority.issue(name, (), 1)
    return authority


def settings_of(folder: Path, name: str, **more: object) -> BusSettings:
    """Return the settings of a process with a certificate."""
    files = {"tls_ca": "ca.pem", "tls_certificate": f"{name}.pem", "tls_key": f"{name}.key"}
    return BusSettings.model_validate(
        {**{each: folder / file for each, file in files.items()}, "shared_memory": False, **more}
    )


@contextmanager
def router(
    folder: Path,
    *,
    fleet: str = FLEET,
    rules: bool = True,
    access: Mapping[str, Any] | None = None,
    name: str = "central",
    connect: Sequence[str] = (),
) -> Iterator[tuple[zenoh.Session, str]]:
    """Open a router, with access rules or without; yield its own session, which they do not bind, and its endpoint.

    access: the rules, instead of those for `fleet`. name: in its certificate. connect: to other routers.
    """
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/127.0.0.1")
    settings = settings_of(folder, name, mode="router", listen=[endpoint], connect=connect)
    config = session_config(settings, access=access or access_control(read_fleet(fleet)) if rules else None)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        yield session, endpoint


@contextmanager
def member(folder: Path, name: str, endpoint: str, *, listen: Sequence[str] = ()) -> Iterator[zenoh.Session]:
    """Open a session with a certificate."""
    settings = settings_of(folder, name, connect=[endpoint], listen=listen)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings)))) as session:
        yield session


def fence(session: zenoh.Session) -> None:
    """Return when a router has taken in all that a session sent to it, and the session all that it had for it then.

    Routers end queries that they refuse, too. This one goes after all that was sent before it, whatever its priority.
    """
    assert session.info.routers_zid()
    assert list(session.get("fence", priority=zenoh.Priority.BACKGROUND, timeout=PATIENCE_S)) == []  # no answer is late


class Seen:
    """The keys of what a callback was given."""

    def __init__(self) -> None:
        self.keys: list[str] = []
        self._changed = threading.Condition()

    @property
    def at_once(self) -> "zenoh.handlers.Callback[Any]":
        """A handler that is called before anything later is taken in from the same link."""
        return zenoh.handlers.Callback(self, indirect=False)

    def take(self) -> list[str]:
        """Return the keys so far, and forget them."""
        keys, self.keys = self.keys, []
        return keys

    def __call__(self, sample: Any) -> None:
        with self._changed:
            self.keys.append(str(sample.key_expr))
            self._changed.notify_all()

    def until(self, expected: int) -> list[str]:
        """Return the keys so far, as soon as there are so many."""
        with self._changed:
            self._changed.wait_for(lambda: len(self.keys) >= expected, PATIENCE_S)
            return list(self.keys)

    def after(self, act: Callable[[], object], *, expected: int) -> list[str]:
        """Return what came of an act: as soon as so much is there, or after QUIET_S."""
        self.keys.clear()
        act()
        end = time.monotonic() + (10 if expected else QUIET_S)
        with self._changed:
            while len(self.keys) < max(expected, 1) and (left := end - time.monotonic()) > 0:
                self._changed.wait(left)
            return list(self.keys)


class Fleet:
    """A router and a session of each member."""

    def __init__(self, folder: Path, central: zenoh.Session, endpoint: str, members: dict[str, zenoh.Session]) -> None:
        self.folder = folder
        self.central = central
        self.endpoint = endpoint
        self.members = members


def matching(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # its stub says bool
    return bool(status.matching)


def until_matching(publisher: zenoh.Publisher, *, expected: bool) -> None:
    end = time.monotonic() + (10 if expected else QUIET_S)
    while not matching(publisher) and time.monotonic() < end:
        time.sleep(0.01)
