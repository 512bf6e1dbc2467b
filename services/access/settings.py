"""Settings of `fleetsight pki` and `fleetsight access`."""

from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, ValidationInfo, model_validator

from bus.settings import File
from schemas.errors import SchemaError
from schemas.keys import NAME, check_name
from services.option_names import given_as_options

TAKES: Final = {
    "init": (),
    "issue": ("name", "hosts", "days"),
    "list": (),
    "renew": ("name", "days", "within_days"),
    "revoke": ("name",),
}
"""Settings of each task, beside `folder`."""

NEEDS_NAME: Final = ("issue", "revoke")


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


class PkiSettings(BaseModel):
    """Make and look after the certificates by which a fleet's machines know each other.

    `init` makes the authority, `issue` a certificate and its key for one robot, worker, monitor or tool, named as
    fleet.yaml names it (see `fleetsight access`). `list` says how many days each is good for, `renew` makes one anew
    with the same key, or all that end soon, and `revoke` deletes the key and keeps the name from being used again.
    Files are in --folder: ca.pem goes to every machine, r1.pem and r1.key to r1 alone, ca.key nowhere.
    """

    task: Annotated[Literal["init", "issue", "list", "renew", "revoke"], Field(description="what to do")]
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

    @model_validator(mode="after")
    def _has_what_its_task_takes(self, info: ValidationInfo) -> Self:
        if self.task in NEEDS_NAME and not self.name:
            raise ValueError(f"{self.task} needs a name: fleetsight pki {self.task} r1")
        if more := given_as_options(self, info) - {"task", "folder", *TAKES[self.task]}:
            raise ValueError(f"{self.task} takes no --{min(more).replace('_', '-')}")
        return self


class AccessSettings(BaseModel):
    """Print the rules by which routers let each certificate do what it is for, and nothing else.

    The file names the fleet's robots (robots: [r1..r200]), what other certificates are for (roles: {central: [monitor,
    worldmodel], gpu1: detector, ann: operator, wall: observer}), and those that may do nothing any more (denied:
    [r17]). Routers read the rules when they start: `fleetsight monitor --access access.json`. Under `access_control` a
    zenohd of Zenoh's own takes them too.
    """

    fleet: Annotated[File, Field(description="the file, such as fleet.yaml; also the first argument")]
    to: Annotated[Path | None, Field(description="file to write; standard output by default")] = None
    folder: Annotated[
        Path | None, Field(description="folder of the authority (`fleetsight pki`), whose revoked names are denied too")
    ] = None
