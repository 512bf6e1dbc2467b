from pathlib import Path

import pytest
from pydantic import ValidationError

from services.detector.settings import SHIPPED_MODEL
from services.toolbox.commands import COMMANDS
from services.toolbox.model.settings import ModelSettings

COMMAND = next(command for command in COMMANDS if command.name == "model")


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"task": "use"}, "use needs a model: fleetsight model use NAME"),
        ({"task": "publish"}, "publish needs a file"),
        ({"task": "list", "target": "x"}, "list takes no name"),
        ({"task": "back", "robots": ["r1"]}, "back takes no --robots; only use does"),
        ({"task": "use", "target": "x", "name": "y"}, "use takes no --name; only publish does"),
        ({"task": "use", "target": "x", "json": True}, "use takes no --json; only list does"),
        ({"task": "use", "target": "x", "robots": ["a b"]}, "robot name 'a b'"),
        ({"task": "publish", "target": "/nowhere.pt"}, "/nowhere.pt: no such file"),
        ({"task": "publish", "target": "/"}, "/: a folder"),
        ({"task": "publish", "target": __file__, "name": "a/b"}, "model name 'a/b'"),
        ({"task": "publish", "target": __file__, "int8": "."}, "publish takes no --int8; only export does"),
        ({"task": "export", "target": __file__, "int8": "/nowhere"}, "--int8 /nowhere: no such folder"),
    ],
)
def test_what_does_not_fit_is_refused(fields: dict[str, object], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        ModelSettings.model_validate(fields)


def test_a_file_s_name_that_cannot_be_a_model_s_needs_another(tmp_path: Path) -> None:
    (tmp_path / "my model.pt").touch()
    given = {"task": "publish", "target": str(tmp_path / "my model.pt")}
    with pytest.raises(ValidationError, match="--name gives the model another one than its file has"):
        ModelSettings.model_validate(given)
    assert ModelSettings.model_validate({**given, "name": "mine"}).published_name == "mine"


def test_task_and_model_need_no_option() -> None:
    assert COMMAND.options_of(["use", "site-2", "--robots", "r1"]) == [
        "--task", "use", "--target", "site-2", "--robots", "r1",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("output", "reason"),
    [("best.pt", "the name of an ONNX file ends in .onnx"), ("same.onnx", "that is the file to export")],
)
def test_an_export_overwrites_no_weights(
    output: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "best.pt").write_bytes(b"weights")
    (tmp_path / "same.onnx").symlink_to("best.pt")
    with pytest.raises(ValidationError, match=f"--output {output}: {reason}"):
        ModelSettings.model_validate({"task": "export", "target": "best.pt", "output": output})
    assert ModelSettings(task="export", target="best.pt").exported_file == Path("best.onnx")


@pytest.mark.parametrize("target", ["warehouse-n-seg", "warehouse-n-seg.pt"])
def test_the_shipped_weights_go_by_their_name(target: str) -> None:
    assert ModelSettings.model_validate({"task": "export", "target": target}).file == SHIPPED_MODEL
