"""What each member of the fleet is to be let do: the whole of it, kind of message by kind; all else is forbidden.

Written down apart from the rules that it is held against. OWN: under its own name alone; ANY: under others', too.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

OWN: Final = "own"
ANY: Final = "any"
Rights = Mapping[str, str]


class Case(NamedTuple):
    """One attempt of a member, and whether it is to succeed."""

    name: str
    key: str
    allowed: bool


MESSAGES: Final = {
    "image": "fleet/{robot}/front/color",
    "status": "fleet/{robot}/status",
    "action": "fleet/{robot}/actions",
    "alert": "fleet/{robot}/alerts",
    "call": "fleet/{robot}/service/reset",
    "nearby": "fleet/{robot}/nearby",
    "classes": "fleet/{robot}/front/classes",
    "opinion": "fleet/{robot}/front/opinion",
    "overlay": "fleet/{robot}/front/overlay/detection",
    "distances": "fleet/{robot}/front/distances",
    "objects": "fleet/{robot}/front/objects",
    "budget": "fleet/r2/front/budget/{worker}",
    "detector": "workers/detector/{worker}/status",
    "distance": "workers/distance/{worker}/status",
    "worldmodel": "workers/worldmodel/{worker}/status",
    "settings": "workers/detector/{worker}/settings",
    "infer": "services/detector/infer/{worker}",
    "pulse": "services/monitor/{monitor}/pulse",
    "inventory": "services/monitor/inventory",
    "collect": "services/collect",
    "site": "world/main/changes",
    "report": "warehouses/{warehouse}/report",
    "registry": "models/registry",
    "list": "models/list",
    "piece": "models/piece",
    "publish": "models/publish",
    "use": "models/use",
    "elsewhere": "elsewhere/{robot}",
}
"""Kinds of messages, and their keys; a name in braces is the member's, or somebody else's."""

TOKENS: Final = {
    "robot": "fleet/{robot}/alive",
    "stream": "fleet/{robot}/front/color/alive",
    "classes": "fleet/{robot}/front/classes/alive",
    "list": "fleet/{robot}/@alive/alive",
    "wanted": "fleet/r2/front/color/wanted/here/{worker}",
    "opinion wanted": "fleet/r2/front/color/wanted/here/opinion.{worker}",
    "detector": "workers/detector/{worker}/1/-/alive",
    "serves": "workers/detector/{worker}/serves/r2/front",
    "distance": "workers/distance/{worker}/1/-/alive",
    "worldmodel": "workers/worldmodel/{worker}/1/-/alive",
    "beside": "workers/distance/{worker}/1/{robot}/alive",
    "beside serves": "workers/distance/{worker}/serves/{robot}/front",
    "monitor": "services/monitor/{monitor}/alive",
    "model": "models/alive",
}
"""Kinds of presence tokens."""

FOREIGN: Final = {"robot": "r2", "worker": "gpu2-12-ab", "monitor": "central", "warehouse": "lyon"}
"""Names of others, in keys."""


def _all(kinds: str, how: str) -> Rights:
    return dict.fromkeys(kinds.split(), how)


_STREAMS: Final = "image status action alert call nearby classes opinion overlay distances objects"
_WORKERS: Final = "detector distance worldmodel settings"
_FLEET: Final = _all(f"{_STREAMS} budget {_WORKERS}", ANY)
_READS: Final = {**_FLEET, "site": ANY}
_NEARLY_ALL: Final = {**_READS, **_all("infer pulse inventory collect report", ANY)}
_MODELS: Final = _all("registry list piece publish use", ANY)
_EVERYTHING: Final = {**_NEARLY_ALL, **_MODELS}
_PRESENCE: Final = dict.fromkeys((each for each in TOKENS if each not in {"monitor", "model"}), ANY)

SENDS: Final[Mapping[str, Rights]] = {
    "r1": _all(f"{_STREAMS} detector distance worldmodel", OWN),
    "gpu1": {**_all("classes opinion overlay", ANY), **_all("budget detector settings infer", OWN)},
    "rack1": {**_all("distances objects", ANY), **_all("budget distance", OWN)},
    "world1": {**_all("nearby site", ANY), **_all("budget worldmodel", OWN)},
    "central2": {**_all("action alert pulse inventory", ANY), **_MODELS},
    "ann": {"collect": ANY},
    "berlin": {"report": OWN},
    "second": _EVERYTHING,
}
"""What they put and delete; and answer."""

HEARS: Final[Mapping[str, Rights]] = {
    "r1": {**_all(_STREAMS, OWN), "registry": ANY},
    "gpu1": {**_READS, "registry": ANY},
    "rack1": _READS,
    "world1": _READS,
    "central2": {**_NEARLY_ALL, "registry": ANY},
    "ann": _EVERYTHING,
    "wall": {"classes": ANY},
    "second": _EVERYTHING,
}

ASKS: Final[Mapping[str, Rights]] = {
    **HEARS,
    "r1": {**HEARS["r1"], **_all("list piece", ANY)},
    "gpu1": {**HEARS["gpu1"], **_all("list piece", ANY)},
    "central2": {**HEARS["central2"], "list": ANY},
}

SHOWS: Final[Mapping[str, Rights]] = {
    "r1": {**_all("robot stream classes list beside", OWN), "beside serves": OWN},
    "gpu1": {**_all("wanted detector serves", OWN), "opinion wanted": OWN},
    "rack1": {**_all("wanted distance beside", OWN), "opinion wanted": OWN, "beside serves": OWN},
    "world1": {**_all("wanted worldmodel", OWN), "opinion wanted": OWN},
    "central2": {"wanted": OWN},
    "ann": {"wanted": OWN},
    "second": _PRESENCE,
}

WATCHES: Final[Mapping[str, Rights]] = {
    **dict.fromkeys(("gpu1", "rack1", "world1", "central2", "ann", "second"), _PRESENCE),
    "r1": {
        **_all("robot stream classes list", OWN),
        **_all("detector serves distance worldmodel beside", ANY),
        "beside serves": ANY,
    },
    "wall": {"classes": ANY},
}

MEMBERS: Final = ("r1", "r3", "gpu1", "rack1", "world1", "central2", "ann", "wall", "berlin", "second", "stranger")
"""One of each role, one that is denied, and one that the rules do not know."""

ABLE: Final = "second"
"""Does, as a sentinel, what a member has no right to at all."""


def with_all(
    more: Iterable[tuple[str, str, bool]], rights: Mapping[str, Rights], keys: Mapping[str, str]
) -> list[tuple[str, str, bool]]:
    """Return some attempts and all of `cases`, each once."""
    return list(dict.fromkeys([*more, *cases(rights, keys)]))


def cases(rights: Mapping[str, Rights], keys: Mapping[str, str]) -> Iterator[Case]:
    """Yield each member's attempt at each kind of message, under its own name and under another's."""
    for name in MEMBERS:
        own = {"robot": name, "worker": f"{name}-12-ab", "monitor": name, "warehouse": name}
        for kind, key in keys.items():
            how = rights.get(name, {}).get(kind)
            yield Case(name, key.format(**own), how is not None)
            if "{" in key:
                yield Case(name, key.format(**FOREIGN), how == ANY)


def sentinel(name: str, rights: Mapping[str, Rights], keys: Mapping[str, str]) -> tuple[str, str]:
    """Return who shows that an attempt was refused, and does not just come late, and by which key that is allowed.

    That is the member itself, where it has the right to any of these.
    """
    who = name if name in rights else ABLE
    return next((case.name, case.key) for case in cases(rights, keys) if case.name == who and case.allowed)
