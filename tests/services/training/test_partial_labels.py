"""The loss on Ultralytics' own network, with labels of each kind."""

from typing import Any

import pytest
import torch

from services.simulator.world import CLASSES
from services.training.checkpoints import ARCHITECTURE
from services.training.partial_labels import LabelKind, code_names, loss_class
from services.training.trainer import load_ultralytics

SIDE = 64


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Any:
    load_ultralytics(tmp_path_factory.mktemp("ultralytics"))
    from ultralytics.cfg import get_cfg  # noqa: PLC0415 - after load_ultralytics
    from ultralytics.nn.tasks import SegmentationModel  # noqa: PLC0415

    torch.manual_seed(0)
    made: Any = SegmentationModel(ARCHITECTURE, nc=len(CLASSES), verbose=False)
    made.args = get_cfg(overrides={"overlap_mask": False})
    return made.train()


def losses(
    network: Any, *labels: tuple[int, tuple[float, float, float, float]]
) -> tuple[dict[str, float], torch.Tensor]:
    """Return the parts of the loss on one grey picture with these labels, and how each class's scores are pulled."""
    criterion = loss_class()(network)
    masks = torch.zeros(len(labels), SIDE // 4, SIDE // 4)
    masks[:, 4:12, 4:12] = 1
    batch = {
        "img": torch.full((1, 3, SIDE, SIDE), 0.5),
        "cls": torch.tensor([[float(code)] for code, _ in labels]).view(-1, 1),
        "bboxes": torch.tensor([box for _, box in labels]).view(-1, 4),
        "batch_idx": torch.zeros(len(labels)),
        "masks": masks,
    }
    network.zero_grad()
    predictions = network(batch["img"])
    predictions["scores"].retain_grad()
    total, parts = criterion(predictions, batch)
    total.sum().backward()
    return {name: float(value) for name, value in parts.items()}, predictions["scores"].grad[0].abs().sum(dim=1)


def coded(kind: LabelKind, class_index: int) -> int:
    return kind.code(class_index, len(CLASSES))


EVERYWHERE = (0.5, 0.5, 1.0, 1.0)
MIDDLE = (0.5, 0.5, 0.5, 0.5)


def test_codes_have_a_name_each() -> None:
    codes = [kind.code(index, len(CLASSES)) for kind in LabelKind for index in range(len(CLASSES))]
    assert codes == list(range(len(code_names(CLASSES))))
    assert code_names(CLASSES)[: len(CLASSES)] == list(CLASSES)


def test_an_unknown_class_is_pulled_nowhere(network: Any) -> None:
    _, pulled = losses(network, (coded(LabelKind.UNKNOWN_REGION, 1), EVERYWHERE))
    assert pulled[1] == 0
    assert pulled[0] > 0
    assert pulled[2] > 0


def test_a_region_leaves_the_rest_of_the_picture_known(network: Any) -> None:
    _, everywhere = losses(network)
    _, half = losses(network, (coded(LabelKind.UNKNOWN_REGION, 1), (0.25, 0.5, 0.5, 1.0)))
    assert 0 < half[1] < everywhere[1]
    assert half[0] == pytest.approx(everywhere[0])


def test_a_labelled_object_counts_within_a_region(network: Any) -> None:
    labels = (
        (coded(LabelKind.OBJECT, 1), MIDDLE),
        (coded(LabelKind.UNKNOWN_REGION, 1), EVERYWHERE),
    )
    parts, pulled = losses(network, *labels)
    assert pulled[1] > 0
    assert parts["box_loss"] > 0


def test_a_box_only_object_is_found_but_its_mask_does_not_count(network: Any) -> None:
    whole, _ = losses(network, (coded(LabelKind.OBJECT, 2), MIDDLE))
    boxed, _ = losses(network, (coded(LabelKind.BOX_ONLY, 2), MIDDLE))
    assert whole["seg_loss"] > 0
    assert boxed["seg_loss"] == 0
    assert boxed["box_loss"] == pytest.approx(whole["box_loss"], rel=1e-3)


def test_of_two_objects_only_the_drawn_one_has_a_mask(network: Any) -> None:
    left, right = (0.3, 0.5, 0.3, 0.5), (0.75, 0.5, 0.3, 0.5)
    both, _ = losses(network, (coded(LabelKind.OBJECT, 0), left), (coded(LabelKind.OBJECT, 0), right))
    one, _ = losses(network, (coded(LabelKind.OBJECT, 0), left), (coded(LabelKind.BOX_ONLY, 0), right))
    assert one["seg_loss"] > 0
    assert one["seg_loss"] != pytest.approx(both["seg_loss"])
    assert one["cls_loss"] == pytest.approx(both["cls_loss"], rel=1e-3)
