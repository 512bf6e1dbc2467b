"""A real router, and certificates that are revoked, used for another name, without their key, or over."""

import asyncio
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from services.access.authority import Authority
from services.access.certificates import new_key, pem_of, pem_of_key, sign
from services.access.process import run_access
from services.access.settings import AccessSettings
from tests.services.access.links import PATIENCE_S, Fleet, Seen, fence, member, router

RULES: Final = """
robots: [r1..r3]
roles:
  central: monitor
  gpu1: detector
  gpu2: detector
  gpu3: detector
"""
MEMBERS: Final = ("central", "r1", "r2", "r3", "gpu1", "gpu2", "gpu3")
REVOKED: Final = ("r2", "gpu2")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """A router after some were revoked, with a session of each member; these have copies of their certificates."""
    folder = tmp_path_factory.mktemp("misused") / "pki"
    authority = Authority(folder)
    authority.make()
    for name in MEMBERS:
        authority.issue(name, (), 1)
    kept = folder.parent / "kept"
    shutil.copytree(folder, kept)
    for name in REVOKED:
        authority.revoke(name)
    (folder / "fleet.yaml").write_text(RULES, encoding="utf-8")
    made = folder / "access.json"
    asyncio.run(run_access(AccessSettings(fleet=folder / "fleet.yaml", to=made, folder=folder)))
    with router(folder, access=json.loads(made.read_bytes())) as (central, endpoint), ExitStack() as stack:
        members = {name: stack.enter_context(member(kept, name, endpoint)) for name in MEMBERS[1:]}
        yield Fleet(kept, central, endpoint, members)


def keys_of(name: str) -> Mapping[str, str]:
    """Return what a member does in its own name, and the keys of it."""
    if name.startswith("gpu"):
        return {
            "sends": f"workers/detector/{name}-12-ab/status",
            "deletes": f"workers/detector/{name}-12-ab/status",
            "shows": f"workers/detector/{name}-12-ab/1/-/alive",
            "answers": f"workers/detector/{name}-12-ab/settings",
            "hears": "fleet/r1/front/color",
        }
    return {
        "sends": f"fleet/{name}/status",
        "deletes": f"fleet/{name}/front/color",
        "shows": f"fleet/{name}/alive",
        "answers": f"fleet/{name}/clock",
        "hears": f"fleet/{name}/actions",
    }


ACTS: Final = tuple(keys_of("r1"))


def came_through(fleet: Fleet, session: zenoh.Session, act: str, key: str) -> bool:
    """Act; return whether anything came of it at the router, or, for what is heard, from it."""
    seen = Seen()
    match act:
        case "answers":
            with session.declare_queryable(key, lambda query: query.reply(key, b"x")):
                fence(session)
                replies = [reply.ok is not None for reply in fleet.central.get(key, timeout=PATIENCE_S)]
            assert all(replies)  # none is late
            return bool(replies)
        case "shows":
            with fleet.central.liveliness().declare_subscriber(key, seen.at_once):
                with session.liveliness().declare_token(key):
                    fence(session)
                    found = seen.take()
                fence(session)
            return found == [key]
        case "hears":
            with session.declare_subscriber(key, seen.at_once):
                fence(session)
                fleet.central.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
                fence(session)
                return seen.take() == [key]
        case _:
            with fleet.central.declare_subscriber(key, seen.at_once):
                if act == "sends":
                    session.put(key, b"x")
                else:
                    session.delete(key)
                fence(session)
                return seen.take() == [key]


@pytest.mark.parametrize(("name", "allowed"), [("r1", True), ("r2", False), ("gpu1", True), ("gpu2", False)])
@pytest.mark.parametrize("act", ACTS)
def test_revoked(fleet: Fleet, name: str, act: str, allowed: bool) -> None:  # noqa: FBT001
    """A certificate and key that were copied before their name was revoked open a link, and nothing comes of it."""
    assert came_through(fleet, fleet.members[name], act, keys_of(name)[act]) is allowed


@pytest.mark.parametrize(
    ("name", "speaks_as", "allowed"),
    [("r1", "r1", True), ("r1", "r3", False), ("gpu1", "gpu1", True), ("gpu1", "gpu3", False), ("r1", "gpu1", False)],
)
@pytest.mark.parametrize("act", ["sends", "deletes", "shows", "answers"])
def test_renamed(fleet: Fleet, name: str, speaks_as: str, act: str, allowed: bool) -> None:  # noqa: FBT001
    """A session that speaks under another name than that of its certificate."""
    assert came_through(fleet, fleet.members[name], act, keys_of(speaks_as)[act]) is allowed


def test_renamed_does_not_hear_what_is_for_another(fleet: Fleet) -> None:
    assert not came_through(fleet, fleet.members["r1"], "hears", keys_of("r3")["hears"])


@contextmanager
def linked(folder: Path, name: str, endpoint: str) -> Iterator[bool]:
    """Tell whether a link opens with these files."""
    try:
        with member(folder, name, endpoint) as session:
            yield bool(session.info.links())
    except zenoh.ZError:
        yield False


@pytest.fixture
def own(fleet: Fleet, tmp_path: Path) -> Path:
    """Return a folder with what r1 has: its certificate and key, and the authority's certificate."""
    for file in ("ca.pem", "r1.pem", "r1.key"):
        shutil.copy(fleet.folder / file, tmp_path / file)
    return tmp_path


def key_in(file: Path) -> ec.EllipticCurvePrivateKey:
    key = serialization.load_pem_private_key(file.read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    return key


def signed_by_authority(fleet: Fleet, key: ec.EllipticCurvePrivateKey) -> bytes:
    authority = x509.load_pem_x509_certificate((fleet.folder / "ca.pem").read_bytes())
    return sign("r3", key.public_key(), ["r3"], 1, by=authority, own=key_in(fleet.folder / "ca.key"))


def signed_by_a_robot(fleet: Fleet, key: ec.EllipticCurvePrivateKey) -> bytes:
    """Return a certificate of r3 by r1's, followed by r1's own, as a chain is sent."""
    robot = (fleet.folder / "r1.pem").read_bytes()
    certificate = x509.load_pem_x509_certificate(robot)
    return sign("r3", key.public_key(), ["r3"], 1, by=certificate, own=key_in(fleet.folder / "r1.key")) + robot


def signed_by_itself(_: Fleet, key: ec.EllipticCurvePrivateKey) -> bytes:
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "r3")])
    now = datetime.now(UTC)
    until = now + timedelta(days=1)
    made = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number(), now, until)
    return pem_of(made.sign(key, hashes.SHA256()))


@pytest.mark.parametrize(
    ("forge", "allowed"), [(signed_by_authority, True), (signed_by_a_robot, False), (signed_by_itself, False)]
)
def test_renamed_by_a_forged_certificate(
    fleet: Fleet,
    own: Path,
    forge: Callable[[Fleet, ec.EllipticCurvePrivateKey], bytes],
    allowed: bool,  # noqa: FBT001
) -> None:
    key = new_key()
    (own / "r3.pem").write_bytes(forge(fleet, key))
    (own / "r3.key").write_bytes(pem_of_key(key))
    with linked(own, "r3", fleet.endpoint) as opened:
        assert opened is allowed


@pytest.mark.parametrize(("name", "allowed"), [("r1", True), ("r3", False), ("gpu1", False), ("r2", False)])
def test_replayed(fleet: Fleet, name: str, allowed: bool) -> None:  # noqa: FBT001
    """What a robot sent, sent again just as it was: its key, payload, encoding, attachment and time."""
    key, caught, sender = "fleet/r1/front/info", list[zenoh.Sample](), fleet.members[name]
    with fleet.central.declare_subscriber(key, zenoh.handlers.Callback(caught.append, indirect=False)):
        robot, stamp = fleet.members["r1"], fleet.members["r1"].new_timestamp()
        robot.put(key, b"x", encoding="app/x", attachment=b"1", timestamp=stamp)
        fence(robot)
        (first,) = caught
        sender.put(key, first.payload, encoding=first.encoding, attachment=first.attachment, timestamp=first.timestamp)
        fence(sender)
    assert len(caught) == 1 + allowed


@pytest.mark.parametrize("allowed", [True, False])
def test_replayed_certificate_without_its_key(fleet: Fleet, own: Path, allowed: bool) -> None:  # noqa: FBT001
    """A certificate is seen by all that it connects to; its key is not."""
    if not allowed:
        (own / "r1.key").write_bytes(pem_of_key(new_key()))
    with linked(own, "r1", fleet.endpoint) as opened:
        assert opened is allowed


@pytest.mark.parametrize(("days", "allowed"), [(1.0, True), (1 / 24, True), (-1 / 86_400, False), (-1 / 1_440, False)])
@pytest.mark.parametrize("name", ["r1", "gpu1"])
def test_expired(fleet: Fleet, tmp_path: Path, name: str, days: float, allowed: bool) -> None:  # noqa: FBT001
    """A certificate that is over opens no new link; a renewed one with the same key does."""
    shutil.copytree(fleet.folder, tmp_path / "own")
    Authority(tmp_path / "own").renew(name, days)
    with linked(tmp_path / "own", name, fleet.endpoint) as opened:
        assert opened is allowed


@pytest.mark.parametrize(("days", "allowed"), [(1.0, True), (-1 / 86_400, False)])
def test_expired_router(fleet: Fleet, tmp_path: Path, days: float, allowed: bool) -> None:  # noqa: FBT001
    """Nobody connects to a router whose certificate is over."""
    shutil.copytree(fleet.folder, tmp_path / "own")
    Authority(tmp_path / "own").renew("central", days)
    with router(tmp_path / "own") as (_, endpoint), linked(fleet.folder, "r1", endpoint) as opened:
        assert opened is allowed
