"""Settings for joining the bus, validated; checks that named files exist."""

import re
import stat
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, ValidationInfo, field_validator, model_validator

_ENDPOINT: Final = re.compile(
    r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9A-Fa-f:.]+\]|[^\s\[\]/:?#]+):(?P<port>\d{1,5})(?:[?#]\S*)?"
)

WITH_TLS: Final = ("tls/", "quic/")


def _endpoint(value: str) -> str:
    match = _ENDPOINT.fullmatch(value)
    if match is None or int(match["port"]) > 65535:
        raise ValueError(f"{value!r} is not an endpoint; write it like tcp/192.168.0.1:7447")
    return value


def port_of(endpoint: str) -> str:
    """Return the port of an endpoint, or of a link's end."""
    return re.split("[?#]", endpoint, maxsplit=1)[0].rpartition(":")[2]


def _file(path: Path) -> Path:
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise ValueError(error.strerror) from error
    if not stat.S_ISREG(mode):
        raise ValueError("not a file")
    return path


Endpoint = Annotated[str, AfterValidator(_endpoint)]
File = Annotated[Path, AfterValidator(_file)]


class BusSettings(BaseModel):
    """Settings of every process on the bus. Routers and scouts connect nowhere unless `connect` is given."""

    heading: ClassVar = "Zenoh"

    mode: Literal["router", "peer", "client"] = Field(
        default="client", description="client of a router, peer among peers, or router for clients"
    )
    connect: list[Endpoint] = Field(
        default=["tcp/127.0.0.1:7447"], description="endpoints to connect to; a client uses the first that answers"
    )
    listen: list[Endpoint] = Field(
        default=[],
        validate_default=True,
        description="endpoints to accept connections on; a router needs one, a client serves its machine with it",
    )
    scouting: bool = Field(
        default=False,
        description="find routers and peers by multicast on the local network; default for a client without --connect",
    )
    shared_memory: bool = Field(
        default=True,
        description="pass large payloads on one host through shared memory, if the process may lock it (ulimit -l)",
    )
    lease_s: float = Field(
        default=2.0, ge=0.5, le=60, description="seconds of silence after which a link counts as lost"
    )

    tls: Path | None = Field(
        default=None, description="short for the next three: pki/r1 means pki/ca.pem, pki/r1.pem and pki/r1.key"
    )
    tls_ca: File | None = Field(
        default=None,
        description="certificate of the authority (CA) that issued both ends' certificates of a tls/ link",
    )
    tls_certificate: File | None = Field(default=None, description="this process's certificate for tls/ links")
    tls_key: File | None = Field(default=None, description="the private key of that certificate")
    access: File | None = Field(
        default=None, description="what each certificate may do at this router: rules of `fleetsight access`"
    )
    insecure: bool = Field(
        default=False,
        description="let anybody in who reaches an endpoint of `listen`: to read, and to send as any robot",
    )

    @model_validator(mode="before")
    @classmethod
    def _names_files_by_one_setting(cls, given: Any) -> Any:
        if not isinstance(given, dict) or not given.get("tls"):
            return given
        own = Path(given["tls"])
        files = {"tls_ca": own.with_name("ca.pem")}
        files |= {
            name: own.with_name(own.name + end) for name, end in (("tls_certificate", ".pem"), ("tls_key", ".key"))
        }
        return {**files, **given}

    @field_validator("connect")
    @classmethod
    def _connects_to_a_port(cls, connect: list[str]) -> list[str]:
        for endpoint in connect:
            match = _ENDPOINT.fullmatch(endpoint)
            if match is not None and int(match["port"]) == 0:
                raise ValueError(f"{endpoint!r} has port 0, which only `listen` may have")
        return connect

    @field_validator("listen")
    @classmethod
    def _listens_where_it_must(cls, listen: list[str], info: ValidationInfo) -> list[str]:
        if info.data.get("mode") == "router" and not listen:
            raise ValueError("a router needs at least one endpoint to listen on")
        return listen

    @model_validator(mode="after")
    def _tls_is_mutual(self) -> Self:
        files = {"tls_ca": self.tls_ca, "tls_certificate": self.tls_certificate, "tls_key": self.tls_key}
        missing = [name for name, file in files.items() if file is None]
        if missing and any(endpoint.startswith(WITH_TLS) for endpoint in [*self.connect, *self.listen]):
            raise ValueError(f"{missing[0]}: tls/ and quic/ endpoints need {', '.join(files)}")
        if missing and len(missing) < len(files):
            raise ValueError(f"{missing[0]}: {', '.join(files)} go together")
        return self

    @model_validator(mode="after")
    def _who_listens_applies_rules(self) -> Self:
        if self.access is not None and self.tls_ca is None:
            raise ValueError("access: the rules are by certificate, so it needs tls_ca, tls_certificate, tls_key")
        if self.access is not None and self.has_one_link:
            raise ValueError("access: a client that does not listen applies no rules; give them to the router")
        return self

    @model_validator(mode="after")
    def _routers_and_scouts_connect_only_where_told(self) -> Self:
        if (self.mode == "router" or self.scouting) and "connect" not in self.model_fields_set:
            self.connect = []
        if self.mode == "client" and not self.connect and not self.scouting:
            raise ValueError("connect: a client needs an endpoint to connect to, or scouting")
        if self.mode == "client" and not self.connect and self.listen:
            raise ValueError("connect: a client that listens needs an endpoint to connect to; a peer scouts")
        return self

    @property
    def certificate_name(self) -> str:
        """The name in the certificate, after which its file is called; empty without one."""
        return self.tls_certificate.stem if self.tls_certificate else ""

    @property
    def has_one_link(self) -> bool:
        """Whether this is a client that nobody connects to."""
        return self.mode == "client" and not self.listen

    @property
    def is_listening_client(self) -> bool:
        """Whether this is a client of a router to which others connect."""
        return self.mode == "client" and bool(self.listen)
