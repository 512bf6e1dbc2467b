import socket
from pathlib import Path

import pytest

from bus.sharing.settings import SharingSettings, default_worker_name, machine_name
from schemas.keys import NAME


def test_a_workers_own_name_can_be_a_key() -> None:
    assert NAME.fullmatch(default_worker_name())


def test_two_containers_on_one_host_have_the_same_machine_and_process() -> None:
    assert default_worker_name() != default_worker_name()


@pytest.mark.parametrize(
    ("given", "begins"),
    [
        ({"tls_certificate": "/etc/fleetsight/gpu-1.local.pem", "robots": ["r1"]}, "gpu-1.local-"),
        ({"tls": Path("pki/gpu1"), "robots": ["r1"]}, "gpu1-"),
        ({"robots": ["r1"]}, "r1-"),
        ({"robots": ["r1", "r2"]}, f"{machine_name(socket.gethostname())}-"),
        ({"tls": "a b"}, "a-b-"),
        ({}, f"{machine_name(socket.gethostname())}-"),
    ],
)
def test_its_name_begins_with_the_one_that_routers_know_it_by(given: dict[str, object], begins: str) -> None:
    name = SharingSettings.model_validate(given).worker
    assert name.startswith(begins)
    assert NAME.fullmatch(name)


@pytest.mark.parametrize(
    ("host", "name"),
    [("gpu-1.local", "gpu-1-local"), ("büro", "b-ro"), ("東京", "worker"), ("", "worker"), ("a" * 64, "a" * 50)],
)
def test_hosts_are_called_what_a_key_can_hold(host: str, name: str) -> None:
    assert machine_name(host) == name
    assert NAME.fullmatch(name)
