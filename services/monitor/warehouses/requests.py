"""Asks a warehouse, from its centre, for the objects of one of its sites."""

from typing import Final

from bus import Bus
from schemas import codec, worker_keys
from schemas.world import WorldAnswer, WorldRequest

TIMEOUT_S: Final = 15.0


async def ask_for_objects(bus: Bus, warehouse: str, site: str, wanted: WorldRequest) -> WorldAnswer:
    """Return the objects of a site, as its world model has them now.

    Raises:
        RequestError: the warehouse cannot be reached, does not answer, or knows no such site.
        SchemaError: a name that cannot be one, or an answer that is none.
    """
    key = worker_keys.warehouse_objects(warehouse, site)
    encoding = codec.encoding(WorldRequest)
    reply = await bus.request(key, codec.encode(wanted), encoding=encoding, timeout_s=TIMEOUT_S)
    return codec.decode(WorldAnswer, reply.payload, reply.encoding)
