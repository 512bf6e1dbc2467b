"""A real router under access rules: links, and a robot that others connect to."""

import json
import time
from pathlib import Path

import pytest
import zenoh

from bus.session.config import session_config
from bus.settings import BusSettings
from tests.contract.conftest import free_endpoint
from tests.services.access.links import Fleet, Seen, make_pki, member, router, settings_of, until_matching


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
        assert seen.after(lambda: None, expected=0) == []
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
