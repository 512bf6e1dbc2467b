import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from bus import BusError, BusSettings, open_bus
from bus.session.certificates import check_certificates
from tests.bus.certificates import certificate, make_certificates
from tests.bus.sessions import bus_threads
from tests.contract.conftest import free_endpoint
from tests.waiting import until

NO_CERTIFICATE = "no PEM certificate can be read from it"
NO_KEY = "no PEM private key can be read from it"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates") / "fleet"
    make_certificates(folder)
    (folder / "garbage.pem").write_text("garbage")
    (folder / "damaged.pem").write_text("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n")
    for command in (
        "openssl pkey -in r1.key -aes256 -passout pass:secret -out locked.key",
        "openssl ec -in r1.key -aes256 -passout pass:secret -out locked-old.key",
        "openssl genpkey -algorithm RSA -out other-kind.key",
    ):
        subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
    return folder


def settings(fleet: Path, changed: dict[str, str], **other: object) -> BusSettings:
    files = certificate(fleet, "r1") | {name: fleet / file for name, file in changed.items()}
    return BusSettings.model_validate({**files, **other})


def test_files_that_can_be_used_are_and_so_are_none(fleet: Path) -> None:
    check_certificates(settings(fleet, {}))
    check_certificates(BusSettings())


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"tls_ca": "garbage.pem"}, NO_CERTIFICATE),
        ({"tls_ca": "damaged.pem"}, NO_CERTIFICATE),
        ({"tls_certificate": "garbage.pem"}, NO_CERTIFICATE),
        ({"tls_key": "garbage.pem"}, NO_KEY),
        ({"tls_key": "r1.pem"}, NO_KEY),
        ({"tls_key": "r2.key"}, "does not belong to tls_certificate {fleet}/r1.pem"),
        ({"tls_key": "other-kind.key"}, "does not belong to tls_certificate {fleet}/r1.pem"),
        ({"tls_key": "locked.key"}, "it has a passphrase, which is not supported; give a key without one"),
        ({"tls_key": "locked-old.key"}, "it has a passphrase, which is not supported; give a key without one"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(fleet: Path, changed: dict[str, str], reason: str) -> None:
    ((name, file),) = changed.items()
    with pytest.raises(BusError) as caught:
        check_certificates(settings(fleet, changed))
    assert str(caught.value) == f"{name} {fleet}/{file}: {reason.format(fleet=fleet)}"


@pytest.mark.parametrize("name", ["tls_ca", "tls_certificate", "tls_key"])
def test_a_file_that_may_not_be_read_is_named(fleet: Path, name: str) -> None:
    unreadable = Path("/proc/self/mem")  # also for root: nothing is at its beginning
    given = settings(fleet, {}).model_copy(update={name: unreadable})
    with pytest.raises(BusError, match=rf"^{name} /proc/self/mem: "):
        check_certificates(given)


@pytest.mark.parametrize(
    "side",
    [
        lambda endpoint: {"connect": [endpoint]},
        lambda endpoint: {"mode": "router", "listen": [endpoint]},
        lambda endpoint: {"mode": "router", "listen": [free_endpoint()], "connect": [endpoint]},
    ],
    ids=["client", "router", "connected router"],
)
async def test_neither_end_opens_with_a_file_that_cannot_be_used(
    fleet: Path, side: Callable[[str], dict[str, object]]
) -> None:
    given = settings(fleet, {"tls_key": "r2.key"}, **side(free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")))
    with pytest.raises(BusError, match=r"^tls_key .*/r2\.key: does not belong to tls_certificate .*/r1\.pem$"):
        async with open_bus(given):
            pytest.fail("this must not be entered")
    await until(lambda: bus_threads() == [])
