"""What others may not do, in about six minutes: refusals, floods, and what access rules cost.

    cases, refused          attempts that access rules, certificates or the lack of them forbid, each on a real router
                            with real certificates, and those that came to nothing; also by kind (groups): these are the
                            project's tests of them, run here
    not_passed              those tests that failed, with their preparations and clean-up, and those of what is allowed
                            (by name: not_passed_tests)
    FLOOD_rss_growth_mb     by how much the memory of `fleetsight monitor`, its router included, grew while somebody
                            sent as fast as the link takes it: class lists of more names than there is room for
                            (names), those of one robot's cameras (robot), the largest lists of ever new classes
                            (lists), large statuses of gateways and of workers; presence of ever more robots and
                            cameras (tokens), also in lists (listed), the largest questions (requests), all but the
                            end of the largest message that a router takes in (halves), idle connections
                            to the page from 200 addresses (connections); and that of a
                            distance worker under frames of 1,000 masks, each of all of 4096 x 4096 pixels (masks)
    FLOOD_answers_s         the longest that the monitor took meanwhile, and shortly after, to answer a question about
                            its inventory, under connections also to send its log-in form; that the distance worker took
                            to measure another robot's object
    FLOOD_others_s          the longest that it took meanwhile, and shortly after, to take in a class list of a robot
                            that has no part in the flood
    acl_us_per_message      by how much longer a message takes over a TLS link where the router has access rules
    joining_ms_with_rules   from a robot's opening of its session over TLS until it is seen at the router, whose rules
                            name rules_for_robots robots; and the same without rules

All processes share the machine's cores. It needs what the tests need (`make .venv/.test`).
"""

import asyncio
import signal
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.gateway.processes import PeerError
from benchmarks.machine import machine, versions
from benchmarks.peers.flood import FLOODS
from benchmarks.peers.link_flood import FLOODS as LINK_FLOODS
from benchmarks.progress import note
from benchmarks.security.cost import cost_of_rules
from benchmarks.security.floods import victim
from benchmarks.security.masks import flood_of_masks
from benchmarks.security.refusals import count_refusals
from benchmarks.targets import Targets, at_least, at_most

MOST_MB: Final = 200
MOST_S: Final = 2.0


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.security", __doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each flood (default: 10)")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    note("refusals")
    found: dict[str, Any] = dict(count_refusals())
    note(f"{found['refused']} of {found['cases']} refused\nwhat access rules cost")
    with tempfile.TemporaryDirectory() as folder:
        found |= cost_of_rules(Path(folder) / "pki")
    try:
        found |= asyncio.run(floods(arguments.seconds))
    except* PeerError as failed:
        sys.exit(str(failed.exceptions[0]))
    show(
        {"targets": targets(found), **found, "machine": machine(), "versions": versions(["eclipse-zenoh"])},
        as_json=arguments.json,
    )


async def floods(seconds: float) -> dict[str, Any]:
    """Flood a new monitor with each kind of message."""
    found: dict[str, Any] = {}
    for kind in (*FLOODS, *LINK_FLOODS):
        note(f"flood of {kind}")
        async with victim(page=kind == "connections") as monitor:
            flood = await monitor.flood(kind, seconds)
        note(f"{flood.figures()}")
        found |= {f"{kind}_{name}": value for name, value in flood.figures().items()}
    note("flood of masks")
    masks = await flood_of_masks(seconds)
    note(f"{masks}")
    return found | masks


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target and whether it is met."""
    made = at_least(found, "refused", 1, "cases") | at_most(found, "not_passed", 0)
    for kind in (*FLOODS, *LINK_FLOODS, "masks"):
        if kind != "listed":  # nearly all of it is Zenoh's, which keeps what a link declares while that lasts
            made |= at_most(found, f"{kind}_rss_growth_mb", MOST_MB)
        made |= at_most(found, f"{kind}_answers_s", MOST_S)
    made |= at_most(found, "robot_others_s", MOST_S)
    return made


if __name__ == "__main__":
    main()
