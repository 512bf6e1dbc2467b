import shlex
from pathlib import Path

from services.access.settings import PkiSettings
from services.toolbox.settings import load
from tests.deploy.support.units import DEPLOY, command, values


def settings(name: str, folder: Path) -> PkiSettings:
    """Return the settings that a unit starts with; its files of settings are those in deploy/."""
    (started,) = values(name, "ExecStart")
    program, task, *words = shlex.split(started.replace("/etc/fleetsight", str(DEPLOY)))
    assert (Path(program).name, task) == ("fleetsight", "pki")
    (folder / "fleet.yaml").touch()
    options = [str(folder / word) if word == "fleet.yaml" else word for word in words]
    return load(PkiSettings, command("pki").options_of(options), prog="fleetsight pki").settings


def test_a_machine_renews_what_it_got_where_its_services_look(tmp_path: Path) -> None:
    found = settings("renew", tmp_path)
    assert (found.task, found.renew, found.name, found.at) == ("enrol", True, "r1", "central:7448")
    assert [str(found.into)] == values("renew", "ReadWritePaths")


def test_the_authority_serves_from_the_folder_that_it_may_write(tmp_path: Path) -> None:
    found = settings("enrolment", tmp_path)
    assert (found.task, found.folder, found.fleet) == ("serve", Path("pki"), tmp_path / "fleet.yaml")
    assert not command("pki").ends(found)
    assert command("pki").ends(settings("renew", tmp_path))
    (folder,) = values("enrolment", "StateDirectory")
    assert values("enrolment", "WorkingDirectory") == [f"/var/lib/{folder}"]
