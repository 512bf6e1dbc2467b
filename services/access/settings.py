"""Settings of `fleetsight pki` and `fleetsight access`."""

from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, ValidationInfo, model_validator

from bus.settings import File
from schemas.errors import SchemaError
from schemas.keys import NAME, check_name
from services.access.enrolment_protocol import PORT, Token, parse_address
from services.option_names import Secret, given_as_options

TAKES: Final = {
    "init": ("fleet", "days"),
    "issue": ("name", "hosts", "days", "fleet"),
    "invite": ("name", "hosts", "days", "hours", "replace", "at", "fleet"),
    "serve": ("at", "fleet"),
    "enrol": ("name", "at", "token", "into", "renew"),
    "list": (),
    "renew": ("name", "days", "within_days"),
    "revoke": ("name",),
}
"""Settings of each task, beside `folder`."""

NEEDS_NAME: Final = ("invite", "revoke")
NO_FOLDER: Final = ("enrol",)


def _name(name: str) -> str:
    try:
        if name:
            check_name("certificate", name)
    except SchemaError as error:
        raise ValueError(str(error)) from error
    return name


def _host(host: str) -> str:
    try:
        ip_address(host)
    except ValueError:
        if not NAME.fullmatch(host):
            raise ValueError(f"{host[:80]!r} is neither a host's name nor an address") from None
    return host


def _address(text: str) -> str:
    parse_address(text)
    return text


def check_is_for(name: str, token: Token) -> None:
    """Raise ValueError if a token is for another name than the one that was given, if any."""
    if name not in ("", token.name):
        raise ValueError(f"the token is for {token.name}, not for {name}")


def _token(text: str) -> str:
    return str(Token.parse(text)) if text else text


class PkiSettings(BaseModel):
    """Make and look after the certificates by which a fleet's machines know each other.

    `init` makes the authority, `issue` a certificate and its key for one robot, worker, monitor or tool, named as
    fleet.yaml names it (see `fleetsight access`). `list` says how many days each is good for, `renew` makes one anew
    with the same key, or all that end soon and whose machines do not renew them, and `revoke` deletes the key and keeps
    the name from being used again. Files are in --folder: ca.pem goes to every machine, r1.pem and r1.key to r1 alone,
    ca.key nowhere. With --fleet fleet.yaml, `init` and `issue` make a certificate for every name in that file that has
    none, and access.json beside it, which is what `fleetsight access` writes, or access-berlin.json for each warehouse.

    So that no key is copied, `invite` prints a token, which lets one machine enrol once, and the command to run there:
    `enrol` asks for the token, or reads it from standard input, makes the key, and gets a certificate from `serve`,
    which runs at the authority. `enrol --renew` gets a new one, with the one it has, in the last third of its days.
    """

    task: Annotated[
        Literal["init", "issue", "list", "renew", "revoke", "invite", "serve", "enrol"],
        Field(description="what to do"),
    ]
    name: Annotated[
        str, AfterValidator(_name), Field(description="the certificate's name; also the second argument")
    ] = ""
    folder: Annotated[Path, Field(description="folder of the authority, which no robot should be able to read")] = Path(
        "pki"
    )
    hosts: Annotated[
        list[Annotated[str, AfterValidator(_host)]],
        Field(description="further names and addresses at which others connect to it"),
    ] = []
    days: Annotated[float, Field(gt=0, le=825, description="days for which a certificate is good")] = 90
    within_days: Annotated[
        float, Field(gt=0, le=825, description="without a name, renew those that end within so many days")
    ] = 30

    at: Annotated[
        str | None,
        AfterValidator(lambda text: text if text is None else _address(text)),
        Field(description=f"host:port of `serve`, at which it listens (by default 0.0.0.0:{PORT}) and machines enrol"),
    ] = None
    fleet: Annotated[
        File | None,
        Field(
            description="fleet.yaml, whose denied names are not invited, enrolled or renewed; init and issue make what"
            " its other names lack"
        ),
    ] = None
    hours: Annotated[float, Field(gt=0, le=720, description="hours for which an invitation is good")] = 1
    replace: Annotated[
        bool, Field(description="invite a machine though there is a certificate of its name, whose key is lost")
    ] = False
    token: Annotated[
        str,
        Secret(),
        AfterValidator(_token),
        Field(description="what `invite` printed; asked for if it is not given, and not needed to renew", repr=False),
    ] = ""
    into: Annotated[Path, Field(description="folder for the files of the machine that enrols")] = Path("tls")
    renew: Annotated[bool, Field(description="renew the certificate in --into, if it ends soon")] = False

    @model_validator(mode="after")
    def _enrols_somewhere(self) -> Self:
        if self.task != "enrol":
            return self
        if self.at is None:
            raise ValueError(f"enrol needs --at: where `fleetsight pki serve` runs, such as central:{PORT}")
        if self.renew and not self.name:
            raise ValueError("enrol --renew needs a name: fleetsight pki enrol r1 --renew")
        if not self.renew and self.token:
            check_is_for(self.name, Token.parse(self.token))
        return self

    @model_validator(mode="after")
    def _has_what_its_task_takes(self, info: ValidationInfo) -> Self:
        if self.task in NEEDS_NAME and not self.name:
            raise ValueError(f"{self.task} needs a name: fleetsight pki {self.task} r1")
        if self.task == "issue" and bool(self.name) == bool(self.fleet):
            raise ValueError("issue needs a name, or --fleet for all that have none: fleetsight pki issue r1")
        if self.task == "issue" and self.fleet and self.hosts:
            raise ValueError("--hosts is for one certificate: fleetsight pki issue central --hosts 192.168.0.10")
        if self.task == "init" and not self.fleet and "days" in given_as_options(self, info):
            raise ValueError("init takes --days with --fleet alone: the authority itself is good for longer")
        takes = {"task", *TAKES[self.task], *(() if self.task in NO_FOLDER else ("folder",))}
        if more := given_as_options(self, info) - takes:
            raise ValueError(f"{self.task} takes no --{min(more).replace('_', '-')}")
        return self


class AccessSettings(BaseModel):
    """Print the rules by which routers let each certificate do what it is for, and nothing else.

    The file names the fleet's robots (robots: [r1..r200]), what other certificates are for (roles: {central: [monitor,
    worldmodel], gpu1: detector, ann: operator, wall: observer}), and those that may do nothing any more (denied:
    [r17]). Where it has warehouses (warehouses: {berlin: {robots: [b1..b40]}}) the routers of each get their own, by
    --warehouse. Routers read the rules when they start: `fleetsight monitor --access access.json`. Under
    `access_control` a zenohd of Zenoh's own takes them too.
    """

    fleet: Annotated[File, Field(description="the file, such as fleet.yaml; also the first argument")]
    to: Annotated[
        Path | None, Field(description="file to write, compressed if it ends in .gz; standard output by default")
    ] = None
    warehouse: Annotated[
        str, AfterValidator(_name), Field(description="the warehouse whose routers get the rules, if the file has any")
    ] = ""
    folder: Annotated[
        Path | None, Field(description="folder of the authority (`fleetsight pki`), whose revoked names are denied too")
    ] = None
