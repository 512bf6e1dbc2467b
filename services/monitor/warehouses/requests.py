"""Asks warehouses, from their centre, for the objects of their sites, on behalf of all who look."""

from collections import OrderedDict
from functools import partial
from typing import Final

from bus import Bus
from schemas import codec, worker_keys
from schemas.world import WorldAnswer, WorldRequest
from services.monitor.event_loop.cached_value import CachedValue

TIMEOUT_S: Final = 15.0
MAX_AGE_S: Final = 5.0
"""Maximum age of an answer, in seconds: all who look at a site share it."""

MAX_ANSWERS: Final = 8
"""Answers that are kept: each may have megabytes."""


class WarehouseObjects:
    """The objects of sites of warehouses."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._answers: OrderedDict[tuple[str, str, str], CachedValue[WorldAnswer]] = OrderedDict()

    async def of(self, warehouse: str, site: str, name: str = "") -> WorldAnswer:
        """Return the objects of a site, or of one class of it, as its world model had them MAX_AGE_S ago or later.

        Raises:
            RequestError: the warehouse cannot be reached, does not answer, or knows no such site.
            SchemaError: a name that cannot be one, or an answer that is none.
        """
        asked = (warehouse, site, name)
        answer = self._answers.get(asked)
        if answer is None:
            answer = self._answers[asked] = CachedValue(partial(self._ask, *asked), MAX_AGE_S)
        self._answers.move_to_end(asked)
        if len(self._answers) > MAX_ANSWERS:
            self._answers.popitem(last=False)
        return await answer.get()

    async def _ask(self, warehouse: str, site: str, name: str) -> WorldAnswer:
        key = worker_keys.warehouse_objects(warehouse, site)
        payload, encoding = codec.encode(WorldRequest(name=name)), codec.encoding(WorldRequest)
        reply = await self._bus.request(key, payload, encoding=encoding, timeout_s=TIMEOUT_S)
        return codec.decode(WorldAnswer, reply.payload, reply.encoding)
