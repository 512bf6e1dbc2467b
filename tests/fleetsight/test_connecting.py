"""Joining the fleet, and what keeps a program from it."""

import asyncio
import sys
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

import fleetsight
from bus import BusSettings, open_bus
from schemas.consumer_keys import every_wanted, parse_wanted
from tests.bus.certificates import certificate, make_certificates
from tests.bus.sessions import bus_threads
from tests.contract.conftest import free_endpoint
from tests.fleetsight.stand_in import stand_in
from tests.waiting import next_of, until


async def test_the_environment_says_where_the_fleet_is(monkeypatch: pytest.MonkeyPatch) -> None:
    async with stand_in() as fleet_there:
        monkeypatch.setenv("FLEETSIGHT_CONNECT", fleet_there.endpoint)
        async with fleetsight.connect() as fleet:
            assert await fleet.robots().present() == {"r1"}


async def test_a_router_that_comes_late_is_waited_for() -> None:
    endpoint = free_endpoint()

    async def join() -> str:
        async with fleetsight.connect(endpoint, within_s=30) as fleet:
            return fleet.problem

    joining = asyncio.create_task(join())
    await asyncio.sleep(0.1)
    async with open_bus(BusSettings(mode="router", listen=[endpoint])):
        assert await joining == ""


async def test_no_link_in_time_is_named_with_cause_and_cure() -> None:
    endpoint = free_endpoint()
    with pytest.raises(fleetsight.ConnectError) as refusal:
        async with fleetsight.connect(endpoint, within_s=0.2):
            raise AssertionError
    assert str(refusal.value) == (
        f"there is no link to {endpoint} after 0.2 s: no Zenoh router answers there;"
        " start `fleetsight monitor` there, or name another endpoint"
    )
    assert not bus_threads()


async def test_a_name_that_does_not_resolve_is_the_cause() -> None:
    with pytest.raises(fleetsight.ConnectError, match=r"nobody\.invalid (does not resolve|is)"):
        async with fleetsight.connect("tcp/nobody.invalid:7447", within_s=0.2):
            raise AssertionError


async def test_an_endpoint_that_is_none_is_refused_at_once() -> None:
    with pytest.raises(fleetsight.SettingsError, match="connect: 'central' is not an endpoint"):
        async with fleetsight.connect("central"):
            raise AssertionError


@pytest.mark.parametrize("within_s", [None, "long", float("nan")])
async def test_a_time_that_is_none_is_refused_at_once(within_s: float) -> None:
    with pytest.raises(fleetsight.SettingsError, match=f"^within_s {within_s!r}: "):
        async with fleetsight.connect("tcp/127.0.0.1:9", within_s=within_s):
            raise AssertionError


async def test_settings_stand_alone() -> None:
    with pytest.raises(fleetsight.SettingsError, match="settings: endpoints or files are given beside them"):
        async with fleetsight.connect("tcp/127.0.0.1:1", settings=BusSettings()):
            raise AssertionError


async def test_settings_say_all_at_once() -> None:
    async with stand_in() as there, fleetsight.connect(settings=BusSettings(connect=[there.endpoint])) as fleet:
        assert fleet.problem == ""


async def test_an_endpoint_to_listen_on_that_is_taken_is_named() -> None:
    async with stand_in() as there:
        settings = BusSettings(mode="router", listen=[there.endpoint])
        with pytest.raises(fleetsight.ConnectError, match=there.endpoint):
            async with fleetsight.connect(settings=settings):
                raise AssertionError


def connect_with(
    endpoint: str, files: dict[str, Path], within_s: float = 30
) -> AbstractAsyncContextManager[fleetsight.Fleet]:
    return fleetsight.connect(
        endpoint,
        tls_ca=files["tls_ca"],
        tls_certificate=files["tls_certificate"],
        tls_key=files["tls_key"],
        within_s=within_s,
    )


async def test_certificates_are_used_and_bad_ones_named(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    own, other = certificate(tmp_path, "r1"), certificate(tmp_path, "central")
    async with open_bus(BusSettings.model_validate({"mode": "router", "listen": [endpoint], **other})):
        async with connect_with(endpoint, own) as fleet:
            assert fleet.problem == ""
        with pytest.raises(
            fleetsight.CertificateError, match=r"^tls_key .*central\.key: does not belong to tls_certificate"
        ):
            async with connect_with(endpoint, {**own, "tls_key": other["tls_key"]}):
                raise AssertionError


async def test_who_looks_at_images_shows_the_name_of_its_certificate(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    router = {"mode": "router", "listen": [endpoint], **certificate(tmp_path, "central")}
    async with (
        open_bus(BusSettings.model_validate(router)) as bus,
        bus.watch(every_wanted("r1")) as tokens,
        connect_with(endpoint, certificate(tmp_path, "gpu1")) as fleet,
    ):
        looking = asyncio.ensure_future(anext(aiter(fleet.images("r1", "front"))))
        assert parse_wanted((await next_of(tokens)).key).consumer.startswith("gpu1-")
        looking.cancel()
        await asyncio.wait([looking])


async def test_a_certificate_of_another_fleet_is_a_likely_cause(tmp_path: Path) -> None:
    make_certificates(tmp_path / "fleet")
    make_certificates(tmp_path / "others")
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    router = {"mode": "router", "listen": [endpoint], **certificate(tmp_path / "fleet", "central")}
    async with open_bus(BusSettings.model_validate(router)):
        with pytest.raises(fleetsight.ConnectError, match="nothing answers there, or the certificates do not fit"):
            async with connect_with(endpoint, certificate(tmp_path / "others", "r1"), within_s=1):
                raise AssertionError


async def test_what_the_program_raises_is_raised_and_nothing_is_left() -> None:
    async with stand_in() as there:
        before = len(bus_threads())

        async def fail() -> None:
            async with fleetsight.connect(there.endpoint) as fleet:
                async for _ in fleet.class_lists():
                    raise KeyError("mine")

        with pytest.raises(KeyError, match="mine"):
            await fail()
        await until(lambda: len(bus_threads()) == before)


async def test_cancelled_while_it_connects_nothing_is_left() -> None:
    async def join() -> None:
        async with fleetsight.connect(free_endpoint()):
            raise AssertionError

    joining = asyncio.create_task(join())
    await asyncio.sleep(0.1)
    joining.cancel()
    with pytest.raises(asyncio.CancelledError):
        await joining
    assert not bus_threads()
    assert asyncio.all_tasks() == {asyncio.current_task()}


JOINING = """
import asyncio, resource, sys
import fleetsight

async def main():
    async with fleetsight.connect(settings=settings):
        print(resource.getrlimit(resource.RLIMIT_NOFILE)[0])

settings = fleetsight.BusSettings(connect=[sys.argv[1]], mode=sys.argv[2], shared_memory=False)
resource.setrlimit(resource.RLIMIT_NOFILE, (256, 4096))
asyncio.run(main())
"""


@pytest.mark.parametrize(("mode", "files"), [("client", 256), ("peer", 4096)])
async def test_the_file_limit_of_a_program_is_raised_only_where_others_link_to_it(mode: str, files: int) -> None:
    async with open_bus(BusSettings(mode="router", listen=[endpoint := free_endpoint()])):
        joining = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", JOINING, endpoint, mode),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        said = await joining.communicate()
    assert said == (f"{files}\n".encode(), b"")
