"""Messages between `fleetsight pki enrol` and `fleetsight pki serve`: JSON over HTTPS. Pure.

`GET /authority` is answered with an Authority, which the client compares with its token before it trusts it;
`POST /enrol` with an EnrolRequest, and `POST /renew`, which is empty and comes with the certificate that is to be
renewed, with an Enrolled. Everything else is answered with a Refusal.
"""

import hashlib
from dataclasses import dataclass
from typing import Final

import msgspec

from schemas.errors import SchemaError
from schemas.keys import check_name

PORT: Final = 7448
SERVER_NAME: Final = "enrolment.fleetsight.internal"
"""Name in the server's certificate, and in no other one of an authority: no machine of the fleet can pose as it."""

AUTHORITY_PATH: Final = "/authority"
ENROL_PATH: Final = "/enrol"
RENEW_PATH: Final = "/renew"
MAX_BYTES: Final = 16_384
"""Of a request or an answer; they have about 1,500."""


class Authority(msgspec.Struct, frozen=True):
    """The authority's certificate, as PEM."""

    authority: str


class EnrolRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A token's name and secret, and a certificate signing request as PEM, whose common name is that name."""

    name: str
    secret: str
    request: str


class Enrolled(msgspec.Struct, frozen=True):
    """The certificate asked for and the authority's, as PEM."""

    certificate: str
    authority: str


class Refusal(msgspec.Struct, frozen=True):
    """Why it was refused, and what helps."""

    error: str


@dataclass(frozen=True, slots=True)
class Token:
    """Lets one machine enrol once. authority: fingerprint of the authority's public key; secret: 128 random bits."""

    name: str
    secret: str
    authority: str

    @classmethod
    def parse(cls, text: str) -> "Token":
        """Read a token.

        Raises:
            ValueError: it is none.
        """
        name, *more = text.strip().split(":")
        try:
            check_name("certificate", name)
            secret, authority = more
        except (SchemaError, ValueError):
            raise ValueError(
                "this is no token: copy all that `fleetsight pki invite` printed, name:secret:fingerprint"
            ) from None
        return cls(name, secret, authority)

    def __str__(self) -> str:
        """Return the token as it is handed over."""
        return f"{self.name}:{self.secret}:{self.authority}"


def digest_of(secret: str) -> str:
    """Return the form in which the authority keeps a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def parse_address(text: str) -> tuple[str, int]:
    """Return the host and the port of `host:port`, `[::1]:port` or `host`, which means PORT.

    Raises:
        ValueError: it is no address.
    """
    host, colon, port = text.rpartition(":") if not text.endswith("]") else (text, "", "")
    if not colon:
        host, port = text, str(PORT)
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not bare or (":" in bare and bare == host) or "/" in bare or not port.isdecimal() or int(port) > 65_535:
        raise ValueError(f"{text[:80]!r} is no address; write it like central:{PORT}")
    return bare, int(port)
