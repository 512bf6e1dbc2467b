"""Exported models find what the weights find that they were made of, without torch; others are refused in one line."""

import base64
import os
import subprocess
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnxruntime.transformers.float16 import convert_float_to_float16

from schemas.detections import Detection
from services.detector.model import DetectedObjects, ModelError
from services.detector.runtime import postprocess
from services.detector.runtime.exported_loading import _candidates
from services.detector.runtime.exported_model import (
    AGNOSTIC,
    HEAD,
    INT8,
    INT8_REFINER,
    REFINER,
    SOURCE,
    read_exported,
)
from services.detector.runtime.loading import load
from services.detector.runtime.model_file import Task
from services.detector.runtime.overlap import MAX_SCORE_GAP, MIN_OVERLAP, boxes_of, difference, ious
from services.detector.runtime.portable import portable
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL, DetectorSettings
from services.model_registry.registry import digest_of
from tests.services.detector.runtime.bare_calls import SIDE, bare, check_same, picture, vars_of
from tests.services.detector.support.requests import request
from tests.services.detector.support.views import near_view

pytestmark = pytest.mark.usefixtures("shut_network")


def found_by(model: Path, image: NDArray[np.uint8], folder: Path, **options: object) -> list[Detection]:
    chosen = {"model": str(model), "cache": folder / "of exports", "device": "cpu", **options}
    loaded = load(DetectorSettings.model_validate(chosen), folder / "ultralytics")
    try:
        (outcome,) = loaded.run([request(image, masks=True)])
    finally:
        loaded.close()
    assert isinstance(outcome, DetectedObjects), outcome
    return outcome.objects


@pytest.fixture(scope="module")
def view() -> NDArray[np.uint8]:
    return near_view()


@pytest.fixture(scope="module")
def expected(view: NDArray[np.uint8], model_folder: Path) -> list[Detection]:
    """Return what the shipped weights find under torch."""
    found = found_by(SHIPPED_MODEL, view, model_folder, runtime="torch")
    assert len(found) >= 3
    return found


@pytest.mark.parametrize("runtime", ["onnx", "openvino"])
def test_the_shipped_export_finds_what_the_shipped_weights_find(
    runtime: str, view: NDArray[np.uint8], expected: list[Detection], model_folder: Path
) -> None:
    found = found_by(SHIPPED_EXPORT, view, model_folder, runtime=runtime)
    assert difference(found, expected, 0.25) is None
    assert all(each.mask is not None and each.mask.quality is not None for each in found)


def test_int8_networks_find_the_classes_that_the_shipped_weights_find(
    view: NDArray[np.uint8], expected: list[Detection], model_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    found = found_by(SHIPPED_EXPORT, view, model_folder, runtime="openvino-int8")
    assert {each.name for each in found} == {each.name for each in expected}
    best = max(expected, key=lambda each: each.score)
    (overlaps,) = ious(boxes_of([best]), boxes_of(found))
    same = found[int(overlaps.argmax())]
    assert overlaps.max() > MIN_OVERLAP
    assert same.name == best.name
    assert abs(same.score - best.score) < 2 * MAX_SCORE_GAP
    assert all(each.mask is not None and each.mask.quality is not None for each in found)
    assert "masks are not refined in INT8" not in caplog.text


def test_int8_networks_are_no_choice_where_they_are_not_wanted_or_not_there(tmp_path: Path) -> None:
    shipped, without = read_exported(str(SHIPPED_EXPORT)), read_exported(str(changed(tmp_path, **{INT8: None})))
    assert _candidates(shipped, DetectorSettings(), None) == ("openvino", "openvino-int8", "onnx")
    assert _candidates(shipped, DetectorSettings(int8=False), None) == ("openvino", "onnx")
    assert _candidates(without, DetectorSettings(), None) == ("openvino", "onnx")
    assert _candidates(shipped, DetectorSettings(int8=False, runtime="openvino-int8"), None) == ("openvino-int8",)
    assert _candidates(shipped, DetectorSettings(), 0) == ("onnx",)
    with pytest.raises(ModelError, match=r"changed\.onnx contains no INT8 networks: export its weights with --int8"):
        _candidates(without, DetectorSettings(runtime="openvino-int8"), None)


def test_the_shipped_export_is_that_of_the_shipped_weights() -> None:
    exported = read_exported(str(SHIPPED_EXPORT))
    assert metadata(SHIPPED_EXPORT)[SOURCE] == digest_of(SHIPPED_MODEL)
    assert exported.int8 is not None
    assert exported.int8.refiner is not None
    assert (exported.longest, exported.fixed, exported.many, exported.task) == (640, None, True, Task("segment"))
    assert dict(exported.names) == {0: "box", 1: "pallet", 2: "forklift"}


def test_auto_chooses_among_what_is_installed(
    view: NDArray[np.uint8], expected: list[Detection], tmp_path: Path
) -> None:
    assert difference(found_by(SHIPPED_EXPORT, view, tmp_path, int8=False), expected, 0.25) is None
    (choice,) = (tmp_path / "of exports").glob("choice-*")
    assert choice.read_text().splitlines()[0] in ("onnx", "openvino")  # the next line says if the machine was busy


def test_masks_stay_coarse_where_they_are_not_to_be_refined(view: NDArray[np.uint8], model_folder: Path) -> None:
    found = found_by(SHIPPED_EXPORT, view, model_folder, runtime="onnx", refine=False)
    assert found
    assert all(each.mask is not None and each.mask.quality is None for each in found)


@pytest.mark.parametrize("runtime", ["onnx", "openvino-int8"])
def test_a_process_with_an_exported_model_imports_no_torch(
    view: NDArray[np.uint8], tmp_path: Path, runtime: str
) -> None:
    np.save(tmp_path / "view.npy", view)
    script = (
        "import sys; from pathlib import Path; import numpy as np\n"
        "from tests.services.detector.runtime.test_exported_model import found_by\n"
        "from services.detector.settings import DetectorSettings\n"
        f"folder = Path({str(tmp_path)!r})\n"
        "model = Path(DetectorSettings(device='cpu').model)\n"
        f"print(len(found_by(model, np.load(folder / 'view.npy'), folder, runtime={runtime!r})))\n"
        "print([each for each in ('torch', 'ultralytics') if each in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    count, imported = done.stdout.splitlines()
    assert int(count) >= 3
    assert imported == "[]"


@pytest.mark.filterwarnings("ignore")  # of torch, about its own exporters
@pytest.mark.parametrize(
    ("architecture", "options"),
    [
        ("yolov8n-seg.yaml", {"dynamic": True}),
        ("yolov8n-seg.yaml", {"imgsz": (96, 160)}),
        ("yolo11n.yaml", {}),
        ("yolo11n.yaml", {"nms": True}),
        ("yolo26n.yaml", {}),
        ("yolov8n-rtdetr.yaml", {}),
        ("yolo11n.yaml", {"format": "openvino"}),
        ("yolo11n.yaml", {"format": "openvino", "dynamic": True}),
    ],
)
def test_what_ultralytics_exports_finds_what_ultralytics_finds_with_it(
    architecture: str,
    options: Mapping[str, Any],
    tmp_path: Path,
    model_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from ultralytics.models import YOLO  # noqa: PLC0415 - it must be offline by then

    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - as above

    monkeypatch.setattr(postprocess, "MOSTLY", 1.0)
    weights: Any = YOLO(built_models.write(built_models.build(architecture), tmp_path / "built.pt"))
    chosen = {"format": "onnx", "imgsz": SIDE, "device": "cpu", "verbose": False, **options}
    file = Path(weights.export(**chosen))
    height, width = chosen["imgsz"] if isinstance(chosen["imgsz"], tuple) else (96, SIDE)
    image = picture(height, width) if "-seg" in architecture else picture()
    expected = bare(file, image, imgsz=chosen["imgsz"])
    found = found_by(file, image, model_folder, runtime="onnx" if file.suffix == ".onnx" else "openvino")
    check_same(np.array([(*vars_of(each.box), each.score, each.label) for each in found]), expected)


@pytest.mark.filterwarnings("ignore")  # of the converter, about numbers that half precision does not know
@pytest.mark.parametrize("runtime", ["onnx", "openvino"])
def test_a_model_in_half_precision_finds_the_same(
    runtime: str, view: NDArray[np.uint8], expected: list[Detection], tmp_path: Path, model_folder: Path
) -> None:
    half = convert_float_to_float16(onnx.load(SHIPPED_EXPORT), keep_io_types=False, op_block_list=["Resize"])
    assert half.graph.input[0].type.tensor_type.elem_type == onnx.TensorProto.FLOAT16
    onnx.save(half, tmp_path / "half.onnx")
    found = found_by(tmp_path / "half.onnx", view, model_folder, runtime=runtime)
    assert difference(found, expected, 0.25) is None


def metadata(file: Path) -> dict[str, str]:
    return {each.key: each.value for each in onnx.load(file).metadata_props}


def changed(folder: Path, **entries: str | None) -> Path:
    """Return a copy of the shipped export with other metadata; None leaves an entry out."""
    model = onnx.load(SHIPPED_EXPORT)
    told = metadata(SHIPPED_EXPORT) | entries
    del model.metadata_props[:]
    onnx.helper.set_model_props(model, {key: value for key, value in told.items() if value is not None})
    onnx.save(model, folder / "changed.onnx")
    return folder / "changed.onnx"


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        (
            {"names": None, "stride": None},
            "it does not say its names, stride: export it with `fleetsight model export`",
        ),
        ({"task": "depth"}, "a model for 'depth', not for one of segment, detect, pose, obb, classify"),
        ({"task": "pose"}, "its keypoints are None, not 1 to 256 of 2 or 3 numbers each"),
        ({"task": "pose", "kpt_shape": "[257, 3]"}, "its keypoints are [257, 3], not 1 to 256 of 2 or 3 numbers each"),
        ({"names": "{0: 'box', 2: 'pallet'}"}, "names of other classes"),
        ({"names": "{0: 'box', 1: ' '}"}, "class 1 has an empty name"),
        ({"names": "__import__('os').getcwd()"}, "its names cannot be read: export it with"),
        ({"names": "{0: 'box', 1: 'pallet'}"}, "not a model that can be used: an output of"),
        ({"stride": "1000000"}, "its stride is 1000000 pixels, not 1 to 256"),
        ({REFINER: "no base64"}, "its refiner is damaged: export it again"),
        ({INT8: "no base64"}, "its INT8 network is damaged: export it again"),
        ({INT8: "bm8gemxpYg=="}, "its INT8 network is damaged: export it again"),
        ({INT8: base64.b64encode(zlib.compress(b"cut off")[:-3]).decode()}, "its INT8 network is damaged"),
        ({INT8_REFINER: "no base64"}, "its INT8 refiner is damaged: export it again"),
    ],
)
def test_metadata_that_cannot_be_right_is_refused(
    entries: dict[str, str | None], reason: str, tmp_path: Path, model_folder: Path
) -> None:
    file = changed(tmp_path, **entries)
    with pytest.raises(ModelError) as refused:
        load(DetectorSettings(model=str(file), runtime="onnx", cache=tmp_path), model_folder / "ultralytics")
    assert f"--model {file}: {reason}" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_weights_beside_an_onnx_file_are_not_looked_for(
    tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would not be published with it."""
    monkeypatch.chdir(tmp_path)  # where ONNX Runtime would look for them
    file = tmp_path / "parted.onnx"
    onnx.save(onnx.load(SHIPPED_EXPORT), file, save_as_external_data=True, location="parted.data", size_threshold=0)
    with pytest.raises(ModelError, match=r"parted\.onnx: not a model that can be used: [^\n]*xternal"):
        load(DetectorSettings(model=str(file), runtime="onnx", cache=tmp_path), model_folder / "ultralytics")


def test_a_folder_of_openvino_without_its_weights_is_refused(tmp_path: Path, model_folder: Path) -> None:
    (tmp_path / "model.xml").write_text("<net/>")
    with pytest.raises(ModelError, match=r"model\.bin, which has its weights, is missing beside model\.xml"):
        load(DetectorSettings(model=str(tmp_path), cache=tmp_path), model_folder / "ultralytics")


def test_the_path_of_an_onnx_file_need_not_be_text(
    view: NDArray[np.uint8], expected: list[Detection], tmp_path: Path
) -> None:
    file = tmp_path / os.fsdecode(b"\xff.onnx")
    file.write_bytes(SHIPPED_EXPORT.read_bytes())
    assert difference(found_by(file, view, tmp_path, runtime="onnx"), expected, 0.25) is None


@pytest.mark.parametrize(
    ("end2end", "nms", "refused"),
    [("True", False, None), ("True", True, "finds each object once"), ("False", False, "needs NMS")],
)
def test_the_head_of_an_export_is_told_by_its_metadata(
    *,
    end2end: str,
    nms: bool,
    refused: str | None,
    tmp_path: Path,
) -> None:
    file = changed(tmp_path, **{HEAD: None, "end2end": end2end})
    if refused is None:
        assert read_exported(str(file), nms=nms).head == "nms-free"
        return
    with pytest.raises(ModelError, match=f"the head that it was exported with {refused}"):
        read_exported(str(file), nms=nms)


def test_a_refiner_that_does_not_work_leaves_masks_coarse(
    view: NDArray[np.uint8], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = changed(tmp_path, **{REFINER: base64.b64encode(b"no network").decode()})
    found = found_by(file, view, tmp_path, runtime="onnx")
    assert all(each.mask is not None and each.mask.quality is None for each in found)
    assert "changed.onnx leaves masks coarse: its refiner does not work" in caplog.text


def test_where_the_refiner_does_not_work_in_int8_it_does_in_single_precision(
    view: NDArray[np.uint8], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = changed(tmp_path, **{INT8_REFINER: base64.b64encode(zlib.compress(b"no network")).decode()})
    found = found_by(file, view, tmp_path, runtime="openvino-int8")
    assert found
    assert all(each.mask is not None and each.mask.quality is not None for each in found)
    assert "changed.onnx: masks are not refined in INT8: " in caplog.text


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (
            {"runtime": "torch"},
            "warehouse-n-seg.onnx is exported, and runs under --runtime openvino or openvino-int8 or onnx",
        ),
        ({"device": "cuda:0"}, "--device cuda:0: ONNX Runtime has no GPU here"),
        ({"device": "tpu"}, "--device tpu: exported models run on cpu or cuda:0"),
        ({"device": "cuda:0", "runtime": "openvino-int8"}, "--runtime openvino-int8 computes on the processor"),
        ({"nms": False}, "the head that it was exported with needs NMS"),
    ],
)
def test_what_an_exported_model_cannot_do_is_said(
    options: Mapping[str, Any], reason: str, tmp_path: Path, model_folder: Path
) -> None:
    chosen = {"model": str(SHIPPED_EXPORT), "cache": tmp_path, **options}
    with pytest.raises(ModelError, match=r"^[^\n]*$") as refused:
        load(DetectorSettings.model_validate(chosen), model_folder / "ultralytics")
    assert reason in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"no model", SHIPPED_EXPORT.read_bytes()[:-100_000]])
def test_a_file_that_is_no_model_is_refused(content: bytes, tmp_path: Path, model_folder: Path) -> None:
    file = tmp_path / "bad.onnx"
    file.write_bytes(content)
    with pytest.raises(ModelError, match=r"bad\.onnx: not a model that can be used: [^\n]+$"):
        load(DetectorSettings(model=str(file), cache=tmp_path), model_folder / "ultralytics")


def test_an_export_of_weights_says_what_they_are(tmp_path: Path) -> None:
    from services.detector.runtime.weights import load_weights  # noqa: PLC0415 - it must be offline by then

    weights = load_weights(str(SHIPPED_MODEL))
    (tmp_path / "made.onnx").write_bytes(portable(weights, 320))
    made = read_exported(str(tmp_path / "made.onnx"))
    told = metadata(tmp_path / "made.onnx")
    assert (told[SOURCE], made.longest, made.names) == (weights.digest, 320, weights.names)
    assert made.refiner is not None
    assert {SOURCE, REFINER} <= told.keys()
    assert not {INT8, INT8_REFINER} & told.keys()
    assert "date" not in told


def test_a_model_that_suppresses_boxes_of_all_classes_by_itself_does_so_exported(tmp_path: Path) -> None:
    assert read_exported(str(changed(tmp_path, **{AGNOSTIC: "True"}))).agnostic
    assert not read_exported(str(SHIPPED_EXPORT)).agnostic
