"""What checkpoints of the trainer are read as, whatever is in them."""

import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from services.simulator.world import CLASSES
from services.training.checkpoints import ARCHITECTURE, Checkpoint
from services.training.trainer import load_ultralytics


def calling(module: str, name: str, *arguments: object) -> bytes:
    """Return a pickle that calls what is called `name`, with dots as protocol 4 allows them, in a module."""
    given = pickle.dumps(arguments, protocol=2).removeprefix(pickle.PROTO + b"\x02").removesuffix(pickle.STOP)
    protocol = pickle.PROTO + (b"\x04" if "." in name else b"\x02")
    return protocol + f"c{module}\n{name}\n".encode() + given + pickle.REDUCE + pickle.STOP


def written(file: Path, content: bytes) -> Path:
    """Write a pickle as torch does."""
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("archive/data.pkl", content)
        archive.writestr("archive/version", "3\n")
    return file


def test_what_a_dotted_name_reaches_is_not_called(tmp_path: Path) -> None:
    made = tmp_path / "made"
    file = written(tmp_path / "a.pt", calling("torch.nn.modules.module", "inspect.os.system", f"touch {made}"))
    with pytest.raises(ValueError, match=r"it calls for torch\.nn\.modules\.module\.inspect\.os\.system"):
        Checkpoint.read(file)
    assert not made.exists()


def test_a_network_is_not_built_from_the_words_of_a_file(tmp_path: Path) -> None:
    made = tmp_path / "made"
    words = {
        "nc": 3,
        "activation": f"__import__('os').mkdir({str(made)!r})",
        "backbone": [[-1, 1, "Conv", [64, 3, 2]]],
        "head": [],
    }
    file = written(tmp_path / "a.pt", calling("ultralytics.nn.tasks", "SegmentationModel", words))
    with pytest.raises(TypeError, match="takes no arguments"):
        Checkpoint.read(file)
    assert not made.exists()


def test_a_file_without_a_network_is_none(tmp_path: Path) -> None:
    file = tmp_path / "a.pt"
    torch.save({"epoch": 1, "ema": {}}, file)
    with pytest.raises(ValueError, match="it holds no network"):
        Checkpoint.read(file)


@pytest.fixture
def network(tmp_path: Path) -> Any:
    """A network as Ultralytics makes it, with weights of its own."""
    load_ultralytics(tmp_path / "ultralytics")
    from ultralytics.nn.tasks import SegmentationModel  # noqa: PLC0415 - after load_ultralytics

    return SegmentationModel(ARCHITECTURE, nc=len(CLASSES), verbose=False).half()


def test_a_network_is_read_as_it_was_kept(network: Any, tmp_path: Path) -> None:
    file, again = tmp_path / "a.pt", tmp_path / "b.pt"
    optimizer = {"state": {0: {"step": torch.tensor(3.0)}}, "param_groups": [{"lr": np.float64(0.5)}]}
    torch.save({"epoch": 2, "ema": network, "optimizer": optimizer, "updates": 7}, file)
    read = Checkpoint.read(file)
    assert (read.epoch, read.going_on["updates"], read.going_on["optimizer"]) == (2, 7, optimizer)
    read.write(again, {"task": "segment"})
    loaded = torch.load(again, weights_only=False)
    assert (loaded["epoch"], loaded["updates"], loaded["train_args"]) == (2, 7, {"task": "segment"})
    assert tuple(loaded["ema"].names.values()) == CLASSES
    kept, made = network.state_dict(), loaded["ema"].state_dict()
    assert list(kept) == list(made)
    assert all(torch.equal(tensor.float(), made[name]) for name, tensor in kept.items())
