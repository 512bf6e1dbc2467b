"""What checkpoints of the trainer are read as, whatever is in them."""

import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from services.simulator.world import CLASSES
from services.training.checkpoints import ARCHITECTURE, CLASS_ROWS, Checkpoint
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

    made: Any = SegmentationModel(ARCHITECTURE, nc=len(CLASSES), verbose=False).half()
    made.names = dict(enumerate(CLASSES))
    return made


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


@pytest.mark.parametrize(
    ("activation", "kept"),
    [
        ("nn.ReLU()", True),
        ("torch.nn.LeakyReLU(0.1, inplace=True)", True),
        ("nn.LeakyReLU(-1e-2)", True),
        ("nn.ReLU() or print(1)", False),
        ("print()", False),
    ],
)
def test_an_activation_is_a_layer_or_nothing(network: Any, tmp_path: Path, activation: str, kept: bool) -> None:  # noqa: FBT001 - a parameter
    network.yaml["activation"] = activation
    torch.save({"ema": network}, tmp_path / "a.pt")
    assert Checkpoint.read(tmp_path / "a.pt").architecture.get("activation") == (activation if kept else None)


@pytest.mark.parametrize("layer", ["torch_safe_load", "nn.functional", "nn.init.normal_", "Path", "TorchVision"])
def test_layers_alone_are_made(network: Any, tmp_path: Path, layer: str) -> None:
    network.yaml["backbone"][0][2] = layer
    torch.save({"ema": network}, tmp_path / "a.pt")
    with pytest.raises(ValueError, match=f"it has {layer} among its layers, which is none to train"):
        Checkpoint.read(tmp_path / "a.pt").network()


def test_classes_take_their_rows_along_and_new_ones_get_random_numbers(network: Any, tmp_path: Path) -> None:
    torch.save({"ema": network}, tmp_path / "a.pt")
    read = Checkpoint.read(tmp_path / "a.pt")
    torch.manual_seed(1)
    changed = read.with_classes(["tote", "forklift", "parcel"], {"box": "parcel", "pallet": "skid"})
    assert changed.classes == ("tote", "forklift", "parcel")
    for name, tensor in read.weights.items():
        if CLASS_ROWS.fullmatch(name):
            assert changed.weights[name][1:].equal(tensor[[2, 0]])
            assert name.endswith("bias") or not changed.weights[name][0].equal(tensor[0])
        else:
            assert changed.weights[name].equal(tensor)
    same = read.with_classes(CLASSES, {})
    assert all(same.weights[name].equal(tensor) for name, tensor in read.weights.items())


def test_published_weights_name_methods_losses_and_paths_that_are_not_called(network: Any, tmp_path: Path) -> None:
    """Those of YOLO11, and of YOLOv8 for masks, have a method among the attributes of their last layer."""
    from ultralytics.nn import modules  # noqa: PLC0415 - after load_ultralytics
    from ultralytics.utils.tal import TaskAlignedAssigner  # noqa: PLC0415

    head, detect = network.model[-1], vars(modules)["Detect"]
    head.detect, head.assigner, head.written = detect.forward, TaskAlignedAssigner(), tmp_path
    torch.save({"epoch": -1, "model": network, "train_args": {"save_dir": tmp_path}}, tmp_path / "a.pt")
    read = Checkpoint.read(tmp_path / "a.pt")
    assert read.classes == CLASSES
    assert list(read.network().state_dict()) == list(network.state_dict())


def test_wide_layers_stay_as_wide_as_they_are(tmp_path: Path) -> None:
    """Of 80 classes Ultralytics makes them wider than of few, and its fine-tuning keeps them so."""
    ultralytics = load_ultralytics(tmp_path / "ultralytics")
    published = ultralytics.YOLO("yolo11n.yaml").model
    published.names = {**published.names, 7: "truck"}
    torch.save({"ema": published}, tmp_path / "a.pt")
    read = Checkpoint.read(tmp_path / "a.pt")
    changed = read.with_classes(["tote", "truck"], {})
    for name, tensor in read.weights.items():
        if CLASS_ROWS.fullmatch(name):
            assert changed.weights[name][1].equal(tensor[7])
        else:
            assert changed.weights[name].equal(tensor)
    changed.write(tmp_path / "b.pt", {})
    again = Checkpoint.read(tmp_path / "b.pt").with_classes(["truck"], {})
    image = torch.rand(1, 3, 64, 64)
    scores = [each.network()(image)[0][0, 4 + row] for each, row in ((read, 7), (again, 0))]
    torch.testing.assert_close(*scores)
