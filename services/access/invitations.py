"""Invitations: the one-time tokens that an authority has given and not yet forgotten, one for each name.

They are files in the authority's folder. Of secrets only hashes are kept, without salt: secrets are random.
"""

import secrets
from collections.abc import Iterator, Sequence
from datetime import datetime
from hmac import compare_digest
from pathlib import Path
from typing import Final

import msgspec

from services.access.authority import Authority, AuthorityError, locked
from services.access.certificates import write
from services.access.enrolment_protocol import Token, digest_of

SECRET_BYTES: Final = 16


class InvitationError(Exception):
    """A token lets nobody enrol; the message says why, and what helps, to somebody who may not have one."""


class Invitation(msgspec.Struct, frozen=True):
    """The certificate that a token is exchanged for.

    until: its end; used, used_from: when it was, and from which address. hosts, days, replace: of the certificate, as
    for `Authority.admit`.
    """

    digest: str
    until: datetime
    hosts: tuple[str, ...]
    days: float
    replace: bool
    used: datetime | None = None
    used_from: str = ""


class Invitations:
    """The invitations of an authority."""

    def __init__(self, authority: Authority) -> None:
        self._authority = authority
        self._folder = authority.folder / "invitations"

    def make(
        self, name: str, *, until: datetime, hosts: Sequence[str] = (), days: float = 90, replace: bool = False
    ) -> Token:
        """Make a token, in place of the one that this name may have had.

        Raises:
            AuthorityError: no certificate of this name can be given, see `Authority.check_free`.
        """
        token = Token(name, secrets.token_urlsafe(SECRET_BYTES), self._authority.fingerprint())
        with locked(self._authority.folder):
            self._authority.check_free(name, hosts, replace=replace)
            self._folder.mkdir(exist_ok=True, mode=0o700)
            self._write(name, Invitation(digest_of(token.secret), until, tuple(hosts), days, replace))
        return token

    def use(self, name: str, secret: str, *, address: str, now: datetime) -> Invitation:
        """Use a token: nobody can do so again.

        name: one that is checked, see `schemas.keys.check_name`; it becomes a file's.

        Raises:
            InvitationError: it was used, has ended, or was never made.
        """
        cure = f"`fleetsight pki invite {name}` at the authority makes another token"
        with locked(self._authority.folder):
            found = self._read(name)
            if found is None or not compare_digest(found.digest, digest_of(secret)):
                raise InvitationError(f"the token is not, or no longer, that of {name}: {cure}")
            if found.used is not None:
                raise InvitationError(
                    f"the token was used at {_shown(found.used)} from {found.used_from}. If that was none of your "
                    f"machines, run `fleetsight pki revoke {name}` at the authority and take another name; "
                    f"else `fleetsight pki invite {name} --replace` there makes another token"
                )
            if found.until <= now:
                raise InvitationError(f"the token was good until {_shown(found.until)}: {cure}")
            self._write(name, msgspec.structs.replace(found, used=now, used_from=address))
        return found

    def has_enrolled(self, name: str) -> bool:
        """Return whether the machine of this name has enrolled, so that it renews its certificate itself."""
        found = self._read(name)
        return found is not None and found.used is not None

    def pending(self, now: datetime) -> Iterator[tuple[str, datetime]]:
        """Yield the names whose tokens can still be used, and until when."""
        for file in sorted(self._folder.glob("*.json")):
            found = self._read(file.stem)
            if found is not None and found.used is None and found.until > now:
                yield file.stem, found.until

    def withdraw(self, name: str) -> bool:
        """Forget the invitation of a name; return whether it could still have been used."""
        with locked(self._authority.folder):
            found = self._read(name)
            self._file(name).unlink(missing_ok=True)
        return found is not None and found.used is None

    def _read(self, name: str) -> Invitation | None:
        file = self._file(name)
        try:
            return msgspec.json.decode(file.read_bytes(), type=Invitation)
        except FileNotFoundError:
            return None
        except msgspec.DecodeError as error:
            raise AuthorityError(f"{file}: no invitation can be read from it; delete it and invite again") from error

    def _write(self, name: str, invitation: Invitation) -> None:
        write(self._file(name), msgspec.json.encode(invitation), mode=0o600)

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.json"


def _shown(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d %H:%M} UTC"
