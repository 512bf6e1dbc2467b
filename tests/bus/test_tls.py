"""Links with certificates."""

import asyncio
import shutil
from pathlib import Path

import pytest

from bus import QUEUE, BusSettings, QoS, open_bus
from tests.bus.certificates import certificate, make_certificates
from tests.bus.sessions import LEASE_S
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until


def with_certificate(folder: Path, host: str, **settings: object) -> BusSettings:
    return BusSettings.model_validate({"lease_s": LEASE_S, **certificate(folder, host), **settings})


async def test_only_who_has_a_certificate_of_the_fleet_is_heard(tmp_path: Path) -> None:
    fleet, others = tmp_path / "fleet", tmp_path / "others"
    make_certificates(fleet)
    make_certificates(others)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    plain = BusSettings(connect=[endpoint.replace("tls/", "tcp/")], lease_s=LEASE_S)
    async with (
        open_bus(with_certificate(fleet, "central", mode="router", listen=[endpoint])) as centre,
        centre.subscribe("fleet/**", QUEUE(9)) as heard,
        open_bus(with_certificate(others, "r1", connect=[endpoint])) as stranger,
        open_bus(plain) as open_link,
        open_bus(with_certificate(fleet, "r1", connect=[endpoint])) as robot,
    ):
        for name, bus in {"stranger": stranger, "plain": open_link, "r1": robot}.items():
            async with bus.publisher(f"fleet/{name}/text/hello", QoS.RESULT) as hello:
                hello.put(b"hello")
                if bus is robot:
                    assert (await next_of(heard)).key == "fleet/r1/text/hello"
                else:
                    await asyncio.sleep(LEASE_S)  # in which it tries again
        await until(lambda: robot.link_problem == "")
        assert stranger.link_problem == f"there is no link to {endpoint}"
        assert heard.counts.received == 1


async def test_a_centre_of_another_name_is_not_joined(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    make_certificates(tmp_path / "fleet")
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/127.0.0.2")
    async with (
        open_bus(with_certificate(tmp_path / "fleet", "r1", mode="router", listen=[endpoint])),
        open_bus(with_certificate(tmp_path / "fleet", "central", connect=[endpoint])) as robot,
    ):
        await asyncio.sleep(LEASE_S)  # in which it tries again
        assert robot.link_problem == f"there is no link to {endpoint}"
    said = "nothing answers there, or the certificates do not fit"
    assert [record.getMessage() for record in caplog.records if record.name == "bus.session.session"] == [
        f"waiting for a link to {endpoint}: {said}"
    ]


async def test_old_certificates_and_renewed_ones_fit_each_other(tmp_path: Path) -> None:
    old, renewed = tmp_path / "old", tmp_path / "renewed"
    make_certificates(old)
    shutil.copytree(old, renewed)
    make_certificates(renewed)
    for file in (certificate(Path(), "r1")[name] for name in ("tls_ca", "tls_certificate")):
        assert (old / file).read_bytes() != (renewed / file).read_bytes()
    for central, robot in ((old, renewed), (renewed, old)):
        endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
        async with (
            open_bus(with_certificate(central, "central", mode="router", listen=[endpoint])),
            open_bus(with_certificate(robot, "r1", connect=[endpoint])) as bus,
        ):
            await until(lambda: bus.link_problem == "")
