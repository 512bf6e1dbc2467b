"""Plans the registration calls that bring the master in line with a node, without I/O.

Pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from gateway.ros1.master import SystemState


class Role(Enum):
    PUBLISHER = "publisher"
    SUBSCRIBER = "subscriber"


@dataclass(frozen=True, slots=True)
class Registration:
    role: Role
    topic: str
    type_name: str


@dataclass(frozen=True, slots=True)
class Changes:
    """Calls to make, in this order."""

    unregister: tuple[Registration, ...]
    register: tuple[Registration, ...]


class Registrations:
    """Tracks the wanted registrations and those that the master may hold.

    A call that failed may still have arrived: a registration that was tried counts as held until it is unregistered, or
    until the master, which goes by role, topic and node alone, took another type in its place. A registration that is
    wanted again is made again, because the new client needs the answer, which lists the other nodes.
    """

    def __init__(self, node: str) -> None:
        self._node = node
        self.wanted: set[Registration] = set()
        self.held: set[Registration] = set()
        self._confirmed: set[Registration] = set()
        self._in_flight: set[Registration] = set()

    def rename(self, node: str) -> None:
        """Register everything under another name, of which the master knows nothing yet."""
        self._node = node
        self.held.clear()
        self._confirmed.clear()
        self._in_flight.clear()

    def want(self, registration: Registration) -> None:
        self.wanted.add(registration)
        self._confirmed.discard(registration)
        self._in_flight.discard(registration)

    def plan(self) -> Changes:
        """Return the calls to make now."""
        return Changes(
            unregister=tuple(self.held - self.wanted),
            register=tuple(self.wanted - self._confirmed),
        )

    def registering(self, registration: Registration) -> None:
        self.held.add(registration)
        self._in_flight.add(registration)

    def registered(self, registration: Registration) -> None:
        if registration in self._in_flight:
            self._confirmed.add(registration)
        self._in_flight.discard(registration)
        place = registration.role, registration.topic
        self.held = {each for each in self.held if each == registration or (each.role, each.topic) != place}

    def unregistered(self, registration: Registration) -> None:
        self.held.discard(registration)
        self._confirmed.discard(registration)

    def compare(self, state: SystemState, links: Mapping[str, Collection[bool]], *, renew: bool = False) -> bool:
        """Forget registrations that the master does not confirm, and subscriptions with outdated publishers.

        Returns whether the master has forgotten everything it held, so that it is a new one.

        `links` says by topic for each known publisher whether it is connected. One that is not may be gone, with a
        namesake at another URI listed in its place: the answer to registering again holds the URIs. `renew` asks for it
        anyway: a publisher may be connected on and yet have been replaced.
        """
        listed = {registration for registration in self._confirmed if self._listed(registration, state)}
        is_new = bool(self._confirmed) and not listed
        self._confirmed = {
            registration for registration in listed if not _stale(registration, state, links, renew=renew)
        }
        return is_new

    def _listed(self, registration: Registration, state: SystemState) -> bool:
        by_topic = state.publishers if registration.role is Role.PUBLISHER else state.subscribers
        return self._node in by_topic.get(registration.topic, ())


def _stale(
    registration: Registration, state: SystemState, links: Mapping[str, Collection[bool]], *, renew: bool
) -> bool:
    if registration.role is Role.PUBLISHER:
        return False
    connected = links.get(registration.topic, ())
    return renew or not all(connected) or len(connected) != len(state.publishers.get(registration.topic, ()))
