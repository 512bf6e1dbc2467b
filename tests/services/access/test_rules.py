"""A real router under access rules: links, those that the rules allow nothing, a robot that others connect to."""

import json
import time
from pathlib import Path

import pytest
import zenoh

from bus import open_bus
from bus.session.config import session_config
from bus.settings import BusSettings
from services.access.fleet_file import read_fleet
from services.access.rules import access_control
from tests.contract.conftest import free_endpoint
from tests.services.access.links import (
    FLEET,
    Fleet,
    Seen,
    make_pki,
    member,
    router,
    settings_of,
    until_matching,
)
from tests.waiting import until


def test_a_robot_and_its_neighbour_are_told_of_demand_and_not_of_other_robots(fleet: Fleet) -> None:
    near = free_endpoint()
    with (
        member(fleet.folder, "r2", fleet.endpoint, listen=[near]) as gateway,
        zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(BusSettings(connect=[near]))))) as beside,
    ):
        publisher = gateway.declare_publisher("fleet/r2/front/color")
        distances = beside.declare_publisher("fleet/r2/front/distances")
        of_another = beside.declare_publisher("fleet/r1/front/distances")
        others = beside.liveliness().declare_subscriber("fleet/**", seen := Seen(), history=True)
        subscriber = fleet.members["gpu1"].declare_subscriber("fleet/*/*/color", heard := Seen())
        until_matching(publisher, expected=True)
        end = time.monotonic() + 10
        while not heard.after(lambda: publisher.put(b"x"), expected=0):  # who has just met loses some
            assert time.monotonic() < end
        assert set(heard.keys) == {"fleet/r2/front/color"}
        measured = fleet.members["ann"].declare_subscriber("fleet/*/*/distances", heard)
        until_matching(distances, expected=True)
        of_another.put(b"x")
        while not heard.after(lambda: distances.put(b"x"), expected=0):
            assert time.monotonic() < end
        assert set(heard.keys) == {"fleet/r2/front/distances"}
        token = fleet.central.liveliness().declare_token("fleet/r1/alive")
        of_its_own = beside.liveliness().declare_subscriber("fleet/r2/**", known := Seen(), history=True)
        with fleet.central.liveliness().declare_token("fleet/r2/alive"):
            assert known.until(1) == ["fleet/r2/alive"]
        assert "fleet/r1/alive" not in seen.keys
        of_its_own.undeclare()
        subscriber.undeclare()
        measured.undeclare()
        others.undeclare()
        publisher.undeclare()
        token.undeclare()


def test_a_certificate_of_another_authority_opens_no_link(fleet: Fleet, tmp_path: Path) -> None:
    make_pki(tmp_path / "other")
    settings = settings_of(tmp_path / "other", "r1", connect=[fleet.endpoint])
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings))))


def test_a_link_ends_with_its_certificate(tmp_path: Path) -> None:
    authority = make_pki(tmp_path / "pki")
    authority.renew("r1", 5 / 86_400)
    with router(tmp_path / "pki") as (_, endpoint), member(tmp_path / "pki", "r1", endpoint) as session:
        assert session.info.links()
        end = time.monotonic() + 20
        while session.info.links():
            assert time.monotonic() < end
            time.sleep(0.1)


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
