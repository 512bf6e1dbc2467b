"""Print the alerts of a fleet, and which robots come and go.

python examples/alerts.py; FLEETSIGHT_CONNECT says where the fleet is.
"""

import asyncio
from contextlib import suppress

import fleetsight


async def print_alerts(fleet: fleetsight.Fleet) -> None:
    """Print each alert when it is raised and whenever it changes."""
    async for alert in fleet.alerts():
        print(f"{alert.robot}: {alert.severity}, {alert.state}: {alert.text}", flush=True)


async def print_robots(fleet: fleetsight.Fleet) -> None:
    """Print which robots are there, and which come and go."""
    async for change in fleet.robots():
        print(f"{change.who}: {'here' if change.here else 'gone'}", flush=True)


async def main() -> None:
    """Do both at once."""
    async with fleetsight.connect() as fleet, asyncio.TaskGroup() as group:
        group.create_task(print_alerts(fleet))
        group.create_task(print_robots(fleet))


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(main())
