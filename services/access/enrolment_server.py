"""`fleetsight pki serve`: gives certificates to machines that come with a token, and new ones for those that end soon.

Everything is bounded: connections, in all and for each address, and from the first byte on the time, the size of a
request, and refused attempts.
"""

import asyncio
import contextlib
import logging
import socket
import ssl
import tempfile
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import h11
import msgspec
from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec

from schemas.errors import SchemaError
from schemas.keys import check_name
from services.accepting import accepted
from services.access import enrolment_protocol as protocol
from services.access.authority import Authority, AuthorityError
from services.access.certificates import common_name_of, pem_of, write
from services.access.fleet_file import FleetFileError, read_fleet
from services.access.invitations import InvitationError, Invitations

log = logging.getLogger(__name__)

CONNECTION_S: Final = 10.0
"""From a connection's first packet to its end."""

MAX_CONNECTIONS: Final = 64
MAX_OF_ADDRESS: Final = 16
MAX_REFUSED: Final = 10
"""Attempts of an address that are refused in REFUSED_S, before all of its are."""

REFUSED_S: Final = 60.0
MAX_ADDRESSES: Final = 1_024
OWN_DAYS: Final = 7
OWN_RENEWED_S: Final = 86_400.0
"""The server's own certificate is made anew each day: it lives in memory alone."""


class RefusedError(Exception):
    """A request is refused. status: HTTP's code."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class RefusedAttempts:
    """Counts the refused attempts of each address; the oldest address of too many is forgotten."""

    def __init__(self) -> None:
        self._counts: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def too_many(self, address: str, now: float) -> bool:
        """Return whether an address has to wait. now: seconds of a steady clock."""
        since, count = self._counts.get(address, (now, 0))
        return count >= MAX_REFUSED and now - since < REFUSED_S

    def add(self, address: str, now: float) -> None:
        """Count one."""
        since, count = self._counts.pop(address, (now, 0))
        self._counts[address] = (since, count + 1) if now - since < REFUSED_S else (now, 1)
        if len(self._counts) > MAX_ADDRESSES:
            self._counts.popitem(last=False)


class EnrolmentServer:
    """Answers machines. fleet: the file whose denied names get nothing.

    Raises:
        AuthorityError: there is no authority in the folder, or its key cannot be used.
    """

    def __init__(self, authority: Authority, fleet: Path | None = None) -> None:
        self._authority = authority
        self._invitations = Invitations(authority)
        self._fleet = fleet
        self._refused = RefusedAttempts()
        self._connections = Counter[str]()
        self._tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._tls.minimum_version = ssl.TLSVersion.TLSv1_3
        self._tls.verify_mode = ssl.CERT_OPTIONAL
        self._tls.load_verify_locations(cadata=pem_of(authority.certificate()).decode())
        self._use(self._own_certificate())

    async def serve(self, listening: socket.socket) -> None:
        """Answer whoever connects to a non-blocking socket, until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._renew_own_certificate())
            async for connected, address in accepted(listening):
                if self._connections.total() >= MAX_CONNECTIONS or self._connections[address] >= MAX_OF_ADDRESS:
                    log.warning("too many connections, closed one from %s", address)
                    connected.close()
                    continue
                self._connections[address] += 1
                group.create_task(self._answer(connected, address))

    async def _answer(self, connected: socket.socket, address: str) -> None:
        try:
            async with asyncio.timeout(CONNECTION_S), _tls_stream(connected, self._tls) as (reader, writer):
                await self._respond(reader, writer, address)
        except (OSError, TimeoutError, h11.RemoteProtocolError) as error:  # OSError: also what TLS says
            log.warning("a connection from %s failed: %s", address, str(error) or type(error).__name__)
        except Exception:
            log.exception("a request from %s failed", address)
        finally:
            self._connections[address] -= 1
            self._connections += Counter()  # forgets addresses without any

    async def _respond(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, address: str) -> None:
        http = h11.Connection(h11.SERVER, max_incomplete_event_size=protocol.MAX_BYTES)
        answer: msgspec.Struct
        try:
            request, body = await _read(http, reader)
            presented = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
            answer = await self._handle(request, body, presented, address)
            status = 200
        except RefusedError as refused:
            log.warning("refused %s: %s", address, refused)
            if refused.status in {401, 403}:
                self._refused.add(address, time.monotonic())
            status, answer = refused.status, protocol.Refusal(str(refused))
        content = msgspec.json.encode(answer)
        headers = [("Content-Type", "application/json"), ("Content-Length", str(len(content))), ("Connection", "close")]
        for event in (h11.Response(status_code=status, headers=headers), h11.Data(data=content), h11.EndOfMessage()):
            writer.write(http.send(event) or b"")
        await writer.drain()

    async def _handle(
        self, request: h11.Request, body: bytes, presented: bytes | None, address: str
    ) -> protocol.Authority | protocol.Enrolled:
        if self._refused.too_many(address, time.monotonic()):
            raise RefusedError(429, f"too many refused attempts from {address}: wait for a minute")
        try:
            match request.method, request.target.decode("ascii"):
                case b"GET", protocol.AUTHORITY_PATH:
                    return protocol.Authority(pem_of(await asyncio.to_thread(self._authority.certificate)).decode())
                case b"POST", protocol.ENROL_PATH:
                    return await asyncio.to_thread(self._enrol, body, address)
                case b"POST", protocol.RENEW_PATH:
                    return await asyncio.to_thread(self._renew, presented, address)
        except (InvitationError, AuthorityError) as error:
            raise RefusedError(403, str(error)) from error
        except OSError as error:
            log.error("%s: %s", error.filename, error.strerror)  # noqa: TRY400 - the trace says no more
            raise RefusedError(503, "the authority cannot use its files; its log says why") from error
        raise RefusedError(404, "this is for `fleetsight pki enrol` alone")

    def _enrol(self, body: bytes, address: str) -> protocol.Enrolled:
        try:
            asked = msgspec.json.decode(body, type=protocol.EnrolRequest)
            check_name("certificate", asked.name)
        except (msgspec.DecodeError, SchemaError) as error:
            raise RefusedError(400, f"no request can be read from what came: {error}") from error
        key = _key_of(asked)
        self._check_not_denied(asked.name)
        invitation = self._invitations.use(asked.name, asked.secret, address=address, now=datetime.now(UTC))
        signed = self._authority.admit(asked.name, key, invitation.hosts, invitation.days, replace=invitation.replace)
        log.info("%s enrolled from %s, for %g days", asked.name, address, invitation.days)
        return self._enrolled(signed)

    def _renew(self, presented: bytes | None, address: str) -> protocol.Enrolled:
        if presented is None:
            raise RefusedError(401, "no certificate came: only what has one can be renewed")
        old = x509.load_der_x509_certificate(presented)
        self._check_not_denied(common_name_of(old.subject))
        name, signed = self._authority.renew_own(old)
        log.info("%s renewed its certificate from %s", name, address)
        return self._enrolled(signed)

    def _enrolled(self, signed: bytes) -> protocol.Enrolled:
        return protocol.Enrolled(signed.decode(), pem_of(self._authority.certificate()).decode())

    def _check_not_denied(self, name: str) -> None:
        if self._fleet is None:
            return
        try:
            denied = read_fleet(self._fleet.read_text(encoding="utf-8")).denied_names()
        except (OSError, UnicodeError, FleetFileError) as error:
            log.error("%s: %s", self._fleet, error)  # noqa: TRY400 - the trace says no more
            raise RefusedError(503, f"{self._fleet.name} at the authority cannot be used; its log says why") from error
        if name in denied:
            raise RefusedError(403, f"{name} is denied in {self._fleet.name} at the authority")

    async def _renew_own_certificate(self) -> None:
        while True:
            await asyncio.sleep(OWN_RENEWED_S)
            try:
                made = await asyncio.to_thread(self._own_certificate)
                self._use(made)  # here, where handshakes begin: between certificate and key they would fail
            except (AuthorityError, OSError) as error:
                log.error("the server's own certificate cannot be renewed: %s", error)  # noqa: TRY400

    def _own_certificate(self) -> bytes:
        certificate, key = self._authority.certificate_of_server(OWN_DAYS)
        return certificate + key

    def _use(self, made: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:  # OpenSSL reads files alone
            self._tls.load_cert_chain(write(Path(folder) / "own.pem", made, mode=0o600))


@contextlib.asynccontextmanager
async def _tls_stream(
    connected: socket.socket, tls: ssl.SSLContext
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """Open TLS on an accepted connection; at the end, written bytes are sent, unless it failed."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(protocol.MAX_BYTES)
    streams = asyncio.StreamReaderProtocol(reader)
    transport, _ = await loop.connect_accepted_socket(
        lambda: streams, connected, ssl=tls, ssl_handshake_timeout=CONNECTION_S, ssl_shutdown_timeout=1
    )
    writer = asyncio.StreamWriter(transport, streams, reader, loop)
    try:
        yield reader, writer
        writer.close()
        with contextlib.suppress(OSError):  # the peer need not wait for the end of TLS
            await writer.wait_closed()
    finally:
        transport.abort()


async def _read(http: h11.Connection, reader: asyncio.StreamReader) -> tuple[h11.Request, bytes]:
    """Return a request with its body.

    Raises:
        RefusedError: it is too large.
        h11.RemoteProtocolError: it is no HTTP, or ends too early.
    """
    head: h11.Request | None = None
    body = bytearray()
    while True:
        match http.next_event():
            case h11.Request() as request:
                head = request
            case h11.Data(data=piece):
                body += piece
                if len(body) > protocol.MAX_BYTES:
                    raise RefusedError(413, f"the request has more than {protocol.MAX_BYTES} bytes")
            case h11.EndOfMessage() if head is not None:
                return head, bytes(body)
            case h11.NEED_DATA:
                http.receive_data(await reader.read(protocol.MAX_BYTES))
            case _:
                raise h11.RemoteProtocolError("closed before there was a request")


def _key_of(asked: protocol.EnrolRequest) -> ec.EllipticCurvePublicKey:
    """Return the public key of a request for the token's name: nothing else of it is used."""
    try:
        request = x509.load_pem_x509_csr(asked.request.encode())
        key, signed = request.public_key(), request.is_signature_valid
    except (ValueError, UnsupportedAlgorithm) as error:
        raise RefusedError(400, "no certificate signing request can be read from what came") from error
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1) or not signed:
        raise RefusedError(400, "a request must be signed with an elliptic curve key, P-256, of its own")
    if (name := common_name_of(request.subject)) != asked.name:
        raise RefusedError(403, f"the request is for {name[:80]!r}, the token for {asked.name}")
    return key
