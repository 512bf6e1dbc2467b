"""The bill of materials of an image (CycloneDX): Python's packages in it, and Debian's where the image is here."""

import json
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final
from uuid import NAMESPACE_URL, uuid5

from cyclonedx.model.bom import Bom, BomMetaData
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL

LIST: Final = (
    '. /etc/os-release && echo "$ID $VERSION_ID" && '
    "dpkg-query --show --showformat '${db:Status-Abbrev} ${Package} ${Version} ${Architecture} ${source:Package}\\n'"
)
"""Shell commands that print an image's distribution and its packages."""


@dataclass(frozen=True, slots=True)
class Image:
    """An image on this machine. program: that has it, podman or docker. described: what it says of the image."""

    program: str
    name: str
    described: Mapping[str, Any]

    @property
    def size(self) -> Mapping[str, Any]:
        """Its bytes, its id, and when it was made."""
        found = self.described
        return {"bytes": found["Size"], "id": found["Id"].removeprefix("sha256:"), "created": found["Created"]}

    def debian_packages(self) -> list[PackageURL]:
        """Return Debian's packages in it, or those of a distribution made of them.

        Raises:
            RuntimeError: it cannot be started, or has no such packages.
        """
        confined = ("--rm", "--network=none", "--read-only", "--cap-drop=all", "--entrypoint=/bin/sh")
        command = (self.program, "run", *confined, self.name, "-c", LIST)
        told = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - a name of ours
        if told.returncode:
            raise RuntimeError(f"{self.name}: its packages cannot be listed: {told.stderr.strip()}")
        first, *lines = told.stdout.splitlines()
        distribution, _, release = first.partition(" ")
        installed = (line.split() for line in lines if line.startswith("ii "))
        return [
            PackageURL(
                "deb",
                distribution,
                name,
                version,
                {"arch": architecture, "distro": f"{distribution}-{release}"}
                | ({"upstream": source} if source != name else {}),
            )
            for _, name, version, architecture, source in installed
        ]


def find_image(name: str, version: str, revision: str) -> Image | None:
    """Return the image of a version and a commit on this machine.

    None where there is no such image, or neither podman nor Docker.
    """
    for program in filter(shutil.which, ("podman", "docker")):
        told = subprocess.run((program, "image", "inspect", name), capture_output=True, text=True, check=False)  # noqa: S603 - a name of ours
        if told.returncode == 0:
            (found,) = json.loads(told.stdout)
            labels = found["Config"].get("Labels") or {}
            if [labels.get(f"org.opencontainers.image.{each}") for each in ("version", "revision")] == [
                version,
                revision,
            ]:
                return Image(program, name, found)
    return None


def python_packages(versions: Mapping[str, str]) -> list[PackageURL]:
    """Return packages of Python's, given by name and version."""
    return [PackageURL("pypi", None, name, version) for name, version in versions.items()]


def bill_of_materials(target: str, version: str, made: datetime, packages: Iterable[PackageURL]) -> str:
    """Return the CycloneDX file, as JSON, of an image with some packages; the same of the same. made: its release."""
    image = Component(type=ComponentType.CONTAINER, name=f"fleetsight-{target}", version=version)
    image.bom_ref.value = image.name
    listed = [Component(name=each.name, version=each.version, purl=each, bom_ref=each.to_string()) for each in packages]
    bill = Bom(components=listed, metadata=BomMetaData(component=image, timestamp=made))
    bill.register_dependency(image, listed)
    bill.serial_number = uuid5(NAMESPACE_URL, f"fleetsight-{target}-{version}-{made.isoformat()}")
    return make_outputter(bill, OutputFormat.JSON, SchemaVersion.V1_6).output_as_string(indent=2) + "\n"
