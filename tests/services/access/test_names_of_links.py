"""A real router under access rules says which certificates connect that the rules allow nothing."""

import json
from pathlib import Path

from bus import open_bus
from services.access.fleet_file import read_fleet
from services.access.rules import access_control
from tests.contract.conftest import free_endpoint
from tests.services.access.links import FLEET, make_pki, member, settings_of
from tests.waiting import until


async def test_a_name_that_rules_do_not_know_or_deny_is_named_while_it_is_connected(tmp_path: Path) -> None:
    make_pki(tmp_path)
    (tmp_path / "access.json").write_text(json.dumps(access_control(read_fleet(FLEET))))
    endpoint = free_endpoint().replace("tcp/", "tls/")
    settings = settings_of(tmp_path, "central", mode="router", listen=[endpoint], access=tmp_path / "access.json")
    async with open_bus(settings) as bus:
        with member(tmp_path, "r1", endpoint), member(tmp_path, "stranger", endpoint), member(tmp_path, "r3", endpoint):
            await until(lambda: bus.links.count == 3, "all are connected")
            assert bus.links.strangers == 2
            assert [line.split()[1] for line in bus.links.wrong] == ["r3", "stranger"]
        await until(lambda: not bus.links.wrong, "they have gone")
