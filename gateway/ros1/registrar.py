"""Keeps a node registered, even if the master starts late, restarts or loses an update."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gateway.ros1.errors import CallError, Ros1Error, StatusError, UnreachableError
from gateway.ros1.registrations import Changes, Registration, Registrations, Role

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
    from typing import Protocol

    from gateway.ros1.master import MasterClient, SystemState

    class PublisherLists(Protocol):
        """The node's lists of publishers."""

        def update_count(self, topic: str) -> int:
            """Return the number of publisherUpdate calls for the topic."""

        def publishers_registered(self, topic: str, uris: Sequence[str]) -> None: ...

        def links(self) -> Mapping[str, Collection[bool]]:
            """Return by topic whether each known publisher is connected."""


log = logging.getLogger(__name__)
TRIED_AT_ONCE = 20
"""Names that are looked up at the master before it gets a rest."""

RENEWED_EVERY = 10
"""Looks at the master. A link to a publisher that was replaced may still be up, and then looks as it should."""


@dataclass(frozen=True, slots=True)
class MasterState:
    """The master's state at one look.

    number: of this look. node: the name under which this node was registered then. restarts: how often a master was
    found that had forgotten all of the node's registrations.
    """

    number: int
    node: str
    state: SystemState
    restarts: int


class Registrar:
    """Makes all registration calls of a node, one at a time, so that none overtakes another."""

    def __init__(self, *, master: MasterClient, lists: PublisherLists, interval: float) -> None:
        self._master = master
        self._lists = lists
        self._interval = interval
        self._registrations = Registrations(master.caller_id)
        self._first_name = master.caller_id
        self._names = 1
        self._name_lost = False
        self._caller_api = ""
        self._wake = asyncio.Event()
        self._looks = 0
        self.master_answers: bool | None = None
        self._refused: set[Registration] = set()
        self._look: MasterState | None = None
        self._looked = asyncio.Event()

    @property
    def settled(self) -> bool:
        """Whether the master has all wanted registrations and no released ones."""
        return self.master_answers is True and self._registrations.plan() == Changes((), ())

    def want(self, registration: Registration) -> None:
        self._registrations.want(registration)
        self._wake.set()

    def release(self, registration: Registration) -> None:
        self._registrations.wanted.discard(registration)
        self._wake.set()

    def release_all(self) -> None:
        self._registrations.wanted.clear()
        self._wake.set()

    def name_taken(self) -> None:
        """Register everything under another name: another node has this one now."""
        self._name_lost = True
        self._wake.set()

    async def look_after(self, number: int) -> MasterState:
        """Wait until there were more than `number` successful looks at the master; return the newest."""
        while self._look is None or self._look.number <= number:
            await self._looked.wait()
        return self._look

    async def run(self, caller_api: str) -> None:
        """Keep `caller_api`, the node's slave URI, registered as wanted, until cancelled."""
        self._caller_api = caller_api
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            self._wake.clear()
            compare = clock() >= due
            await self._attempt(compare=compare)
            due = clock() + self._interval if compare else due
            await self._woken(due)

    async def finish(self) -> None:
        """Unregister everything; to be called after `run` has ended."""
        self._registrations.wanted.clear()
        await self._attempt(compare=False)

    async def _woken(self, due: float) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout_at(due):
                await self._wake.wait()

    async def _attempt(self, *, compare: bool) -> None:
        try:
            if self._name_lost:
                await self._rename()
            if compare:
                state = await self._master.get_system_state()
                self._looks += 1
                renew = self._looks % RENEWED_EVERY == 0
                forgotten = self._registrations.compare(state, self._lists.links(), renew=renew)
                self._remember(state, is_new=forgotten)
            answered = await self._apply() or compare
        except Ros1Error as error:
            if self.master_answers is not False:
                log.warning("waiting for the ROS master at %s: %s", self._master.uri, error)
            self.master_answers = False
        else:
            if answered:
                self._answered()

    async def _rename(self) -> None:
        """Take the first name that nobody has of those with a number behind the first one.

        Raises:
            Ros1Error: the master does not answer, or many names are taken; the next attempt goes on from there.

        """
        taken = self._master.caller_id
        for registration in list(self._registrations.held):  # one that was under way may have come after the other's
            await self._one(self._unregister, registration)
        name = await self._free_name()
        self._name_lost = False
        self._master.caller_id = name
        self._registrations.rename(name)
        log.error("another node has taken the name %s: this one goes on as %s", taken, name)

    async def _free_name(self) -> str:
        for _ in range(TRIED_AT_ONCE):
            self._names += 1
            name = f"{self._first_name}_{self._names}"
            if await self._is_free(name):
                return name
        raise Ros1Error(
            f"other nodes have {self._master.caller_id} and all names up to {self._first_name}_{self._names}"
        )

    async def _is_free(self, name: str) -> bool:
        try:
            await self._master.lookup_node(name)
        except StatusError:
            return True
        return False

    def _remember(self, state: SystemState, *, is_new: bool) -> None:
        restarts = self._look.restarts if self._look else 0
        self._look = MasterState(self._looks, self._master.caller_id, state, restarts + is_new)
        self._looked.set()
        self._looked.clear()

    def _answered(self) -> None:
        if self.master_answers is False:
            log.info("the ROS master at %s answers", self._master.uri)
        self.master_answers = True

    async def _apply(self) -> bool:
        """Make the calls that are due; return whether there were any."""
        changes = self._registrations.plan()
        for registration in changes.unregister:
            await self._one(self._unregister, registration)
        for registration in changes.register:
            if self._name_lost:
                break  # or the other node would lose the name to us, and end
            self._registrations.registering(registration)
            await self._one(self._register, registration)
        return changes != Changes((), ())

    async def _one(self, call: Callable[[Registration], Awaitable[None]], registration: Registration) -> None:
        """Make one call; if the master refuses it, the others are still made."""
        try:
            await call(registration)
        except UnreachableError:
            raise
        except CallError as error:
            if registration not in self._refused:
                log.error(  # noqa: TRY400 - the master's words say more than our stack
                    "%s: the ROS master refuses us as a %s: %s", registration.topic, registration.role.value, error
                )
            self._refused.add(registration)
        else:
            self._refused.discard(registration)

    async def _register(self, registration: Registration) -> None:
        topic, type_name = registration.topic, registration.type_name
        if registration.role is Role.PUBLISHER:
            await self._master.register_publisher(topic, type_name, self._caller_api)
        else:
            before = self._lists.update_count(topic)
            uris = await self._master.register_subscriber(topic, type_name, self._caller_api)
            # A publisherUpdate that came in the meantime is newer than this answer.
            if self._lists.update_count(topic) == before:
                self._lists.publishers_registered(topic, uris)
        self._registrations.registered(registration)

    async def _unregister(self, registration: Registration) -> None:
        if registration.role is Role.PUBLISHER:
            await self._master.unregister_publisher(registration.topic, self._caller_api)
        else:
            await self._master.unregister_subscriber(registration.topic, self._caller_api)
        self._registrations.unregistered(registration)
