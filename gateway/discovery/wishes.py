"""What the user wants of discovery."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from schemas.keys import SensorKey

EVERYTHING: Final = re.compile(".*")
NOTHING: Final = re.compile("")


@dataclass(frozen=True, slots=True)
class Wishes:
    """What a gateway's settings say of its streams.

    named: topics that are taken as they are, published or not. discover: take what else is found.
    allow, deny: patterns that the whole name of a topic matches which is found; `deny` wins.
    rectified: streams whose pictures are, whatever their topics' names say.
    """

    robot: str
    named: Mapping[SensorKey, str] = field(default_factory=dict)
    discover: bool = True
    allow: re.Pattern[str] = EVERYTHING
    deny: re.Pattern[str] = NOTHING
    rectified: frozenset[SensorKey] = frozenset()
