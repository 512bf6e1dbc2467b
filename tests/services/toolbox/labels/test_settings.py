from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from services.toolbox.errors import UsageError
from services.toolbox.labels.settings import LabelsSettings
from services.toolbox.settings import load


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"task": "export"}, "export needs --to: coco, cvat or label-studio"),
        ({"task": "export", "to": "coco", "from": "coco"}, "export takes no --from"),
        ({"task": "export", "to": "coco", "leave_empty": True}, "export takes no --leave-empty"),
        ({"task": "export", "to": "coco", "image_url": "x"}, "--image-url is for --to label-studio"),
        ({"task": "export", "to": "coco", "target": None}, "export needs a file to write: fleetsight labels export"),
        (
            {"task": "import", "target": None},
            "import needs the folder whose labels these are: fleetsight labels import",
        ),
        ({"task": "check"}, "check takes no --target"),
        ({"task": "import", "to": "coco"}, "import takes no --to"),
        ({"task": "import", "image_url": "x"}, "import takes no --image-url"),
    ],
)
def test_each_task_takes_its_own_options(given: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        LabelsSettings.model_validate({"source": "a", "target": "b", **given})


def test_options_as_they_are_typed() -> None:
    argv = ["--task", "import", "--source", "a.zip", "--target", "site", "--from", "cvat", "--leave-empty"]
    settings = load(LabelsSettings, argv, prog="labels").settings
    assert (settings.source, settings.target, settings.form, settings.leave_empty) == (
        Path("a.zip"),
        Path("site"),
        "cvat",
        True,
    )
    with pytest.raises(UsageError, match="export needs --to"):
        load(LabelsSettings, ["--task", "export", *argv[2:6]], prog="labels")
