import socket
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from services.detector.runtime.offline import keep_offline


@pytest.fixture
def shut_network(monkeypatch: pytest.MonkeyPatch, model_folder: Path) -> Iterator[None]:
    """Let nobody ask for a host or connect to one; whoever tried fails the test, whatever became of the error."""
    keep_offline(model_folder / "ultralytics", download=False)
    tried: list[object] = []

    def refuse(*about: object, **_: object) -> NoReturn:
        tried.append(about)
        raise OSError("the network is shut")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket.socket, "connect_ex", refuse)
    yield
    assert not tried


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the model files built so far, by architecture, and their folder under an empty name."""
    return {"": tmp_path_factory.mktemp("models")}
