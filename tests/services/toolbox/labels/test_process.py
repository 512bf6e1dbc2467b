"""Labels go out to each form and come back, through real files."""

import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

from services.toolbox.labels.objects import LabelsError
from services.toolbox.labels.process import run
from services.toolbox.labels.settings import LabelsSettings
from services.training.photographs import read_photographs
from tests.services.toolbox.labels.making import (
    MANY,
    NAMES,
    POLYGON,
    SQUARE,
    every_kind,
    export,
    labels,
    picture,
    record,
    site,
    take,
    texts,
)

FORMS = {"coco": "labels.json", "cvat": "labels.xml", "label-studio": "tasks.json"}
PATHS = [
    "train/images/Lager ü #3 50%_&'2'.png",
    "train/images/nothing_1.jpeg",
    "train/images/r1-front_1.jpg",
    "val/images/r2.front_9.JPG",
    "val/images/unlabelled_1.jpg",
]


def annotated(tasks: Path) -> Path:
    """Have every task's prediction accepted, as Label Studio exports it."""
    content = json.loads(tasks.read_text(encoding="utf-8"))
    for task in content:
        task["annotations"] = [{"result": each["result"]} for each in task.pop("predictions", [])]
    tasks.write_text(json.dumps(content), encoding="utf-8")
    return tasks


@pytest.mark.parametrize("form", FORMS)
async def test_labels_come_back_as_they_went_out(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, file = every_kind(tmp_path / "site"), tmp_path / FORMS[form]
    before = texts(folder)
    await export(folder, file, form)
    assert f"{file}: 5 pictures, 5 objects (1 box, 2 pallet, 2 {NAMES[2]})\npictures: 4 with drafts, 1 without" in (
        capsys.readouterr().out
    )
    if form == "label-studio":
        annotated(file)
    assert await take(file, folder, leave_empty=form != "label-studio") == 0
    shown = capsys.readouterr().out
    assert texts(folder) == before
    assert all(each["as_before"] and each["by"] == form for each in record(folder))
    if form == "label-studio":
        assert [each["file"] for each in record(folder)] == PATHS[:4]
        assert "4 pictures labelled" in shown
        assert "1 picture left as before" in shown
        assert "others: 1 without labels" in shown
    else:
        assert {each["file"] for each in record(folder)} == {PATHS[0], PATHS[2], PATHS[3]}
        assert "3 pictures labelled" in shown
        assert "2 pictures left as before" in shown
        assert "others: 1 with drafts, 1 without labels" in shown


@pytest.mark.parametrize("form", ["coco", "cvat"])
async def test_a_picture_that_is_listed_without_objects_was_seen_by_a_person(form: str, tmp_path: Path) -> None:
    folder, file = every_kind(tmp_path / "site"), tmp_path / FORMS[form]
    await export(folder, file, form)
    assert await take(file, folder) == 0
    assert [each["file"] for each in record(folder)] == PATHS
    assert texts(folder)["unlabelled_1.txt"] == texts(folder)["nothing_1.txt"] == ""


@pytest.mark.parametrize("form", FORMS)
async def test_labels_reach_a_folder_that_has_none(form: str, tmp_path: Path) -> None:
    folder, file = every_kind(tmp_path / "site"), tmp_path / FORMS[form]
    before = texts(folder)
    await export(folder, file, form)
    if form == "label-studio":
        annotated(file)
    for each in folder.glob("*/labels/*"):
        each.unlink()
    (folder / "boxes_only.txt").unlink()
    await take(file, folder, leave_empty=True)
    assert texts(folder) == {name: text for name, text in before.items() if text}
    assert (folder / "boxes_only.txt").read_text(encoding="utf-8") == "val/images/r2.front_9.JPG\n"


async def test_what_a_person_has_seen_is_no_prediction_any_more(tmp_path: Path) -> None:
    folder = every_kind(tmp_path / "site")
    await export(folder, tmp_path / "1.json", "label-studio")
    tasks = json.loads((tmp_path / "1.json").read_text(encoding="utf-8"))
    assert {each["model_version"] for task in tasks for each in task.get("predictions", [])} == {"warehouse.pt"}
    assert not any("annotations" in task for task in tasks)
    await take(annotated(tmp_path / "1.json"), folder)
    await export(folder, tmp_path / "2.json", "label-studio")
    tasks = json.loads((tmp_path / "2.json").read_text(encoding="utf-8"))
    assert ["annotations" in task for task in tasks] == [True, True, True, True, False]
    assert not any("predictions" in task for task in tasks)


async def test_new_classes_are_added_and_none_is_renumbered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON})
    file = tmp_path / "labels.xml"
    file.write_text(
        '<annotations><image name="a_1.jpg" width="200" height="100">'
        '<polygon label="Größe 2" points="1,1;50,1;50,50"/><box label="pallet" xtl="0" ytl="0" xbr="20" ybr="50"/>'
        "</image></annotations>",
        encoding="utf-8",
    )
    await take(file, folder)
    content = yaml.safe_load((folder / "data.yaml").read_text(encoding="utf-8"))
    names = {0: "box", 1: "pallet", 2: NAMES[2], 3: "Größe 2"}
    assert content == {"path": "/elsewhere", "train": "train/images", "names": names}
    assert texts(folder)["a_1.txt"].splitlines() == [
        "3 0.00500 0.01000 0.25000 0.01000 0.25000 0.50000",
        "1 0.00000 0.00000 0.10000 0.00000 0.10000 0.50000 0.00000 0.50000",
    ]
    assert "new in data.yaml: Größe 2\n" in capsys.readouterr().out
    assert (folder / "boxes_only.txt").read_text(encoding="utf-8") == "train/images/a_1.jpg\n"


async def test_training_tells_boxes_from_polygons_of_four_corners(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": None})
    file = tmp_path / "labels.xml"
    file.write_text(
        '<annotations><image name="a_1.jpg" width="200" height="100">'
        '<box label="box" xtl="0" ytl="0" xbr="20" ybr="50"/><polygon label="box" points="0,0;20,0;20,50;0,50"/>'
        '<box label="box" xtl="80" ytl="20" xbr="120" ybr="60" rotation="45"/></image></annotations>',
        encoding="utf-8",
    )
    await take(file, folder)
    (folder / "data.yaml").write_text("names: [box]")
    (photograph,) = read_photographs(folder, "train")
    assert [each.box_only for each in photograph.objects] == [True, False, False]
    assert photograph.objects[2].box == pytest.approx((0.3586, 0.1172, 0.6414, 0.6828), abs=1e-4)
    await export(folder, tmp_path / "again.xml", "cvat")
    kinds = re.findall(r"<(box|polygon) ", (tmp_path / "again.xml").read_text(encoding="utf-8"))
    assert kinds == ["box", "polygon", "polygon"]


async def test_a_picture_that_loses_its_boxes_is_listed_no_more(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": SQUARE, "train/images/b_1.jpg": SQUARE})
    (folder / "boxes_only.txt").write_text("train/images/a_1.jpg\ntrain/images/b_1.jpg\n", encoding="utf-8")
    file = tmp_path / "labels.xml"
    file.write_text(
        '<annotations><image name="a_1.jpg" width="200" height="100">'
        '<polygon label="box" points="0,0;20,0;20,50;0,50"/></image></annotations>',
        encoding="utf-8",
    )
    await take(file, folder)
    assert (folder / "boxes_only.txt").read_text(encoding="utf-8") == "train/images/b_1.jpg\n"


async def test_a_picture_is_of_the_size_at_which_it_is_shown(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON})
    content = picture(folder / "train/images/a_1.jpg", (200, 100), orientation=6).read_bytes()
    await export(folder, tmp_path / "labels.json", "coco")
    (image,) = json.loads((tmp_path / "labels.json").read_text(encoding="utf-8"))["images"]
    assert (image["width"], image["height"]) == (100, 200)
    await take(tmp_path / "labels.json", folder)
    assert (folder / "train/images/a_1.jpg").read_bytes() == content
    image["width"], image["height"] = 200, 100
    whole = {"images": [image], "categories": [], "annotations": []}
    (tmp_path / "turned.json").write_text(json.dumps(whole), encoding="utf-8")
    with pytest.raises(LabelsError, match="has 100 x 200: the tool does not turn pictures as their EXIF data say"):
        await take(tmp_path / "turned.json", folder)


async def test_archives_of_cvat(tmp_path: Path) -> None:
    folder = every_kind(tmp_path / "site")
    before = texts(folder)
    await export(folder, tmp_path / "annotations.xml", "cvat")
    await export(folder, tmp_path / "instances.json", "coco")
    shutil.make_archive(str(tmp_path / "yolo"), "zip", folder)
    for name, member in (("annotations.xml", "annotations.xml"), ("instances.json", "annotations/instances_val.json")):
        with zipfile.ZipFile(tmp_path / "export.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(tmp_path / name, member)
            archive.writestr("images/r1-front_1.jpg", b"not looked at")
        for each in folder.glob("*/labels/*"):
            each.unlink()
        await take(tmp_path / "export.zip", folder, leave_empty=True)
        assert texts(folder) == {name: text for name, text in before.items() if text}
    assert await take(tmp_path / "yolo.zip", folder) == 0
    assert texts(folder) == before


async def test_a_file_with_a_mistake_changes_nothing(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON, "train/images/b_1.jpg": POLYGON})
    before = texts(folder)
    file = tmp_path / "labels.xml"
    file.write_text(
        '<annotations>\n<image name="a_1.jpg" width="200" height="100">\n<polygon label="new" points="0,0;9,0;9,9"/>\n'
        '</image>\n<image name="b_1.jpg" width="200" height="100">\n<polygon label="box" points="0,0;9,9"/>\n'
        "</image></annotations>",
        encoding="utf-8",
    )
    with pytest.raises(LabelsError, match=r"labels\.xml, line 6: box has no area within the picture"):
        await take(file, folder)
    assert texts(folder) == before
    assert not (folder / "labelled.jsonl").exists()
    assert "new" not in (folder / "data.yaml").read_text(encoding="utf-8")


async def test_unknown_pictures_are_counted_and_files_of_unknown_ones_alone_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, other = site(tmp_path / "a", {"train/images/a_1.jpg": POLYGON}), tmp_path / "b"
    site(other, {f"train/images/{name}_1.jpg": MANY for name in "abcdef"})
    await export(other, tmp_path / "labels.json", "coco")
    assert await take(tmp_path / "labels.json", folder) == 0
    assert "5 pictures of the file not in the folder: b_1.jpg, c_1.jpg, d_1.jpg and 2 more\n" in capsys.readouterr().out
    assert texts(folder) == {"a_1.txt": MANY}
    (folder / "train/images/a_1.jpg").rename(folder / "train/images/z_1.jpg")
    with pytest.raises(LabelsError, match=r"labels\.json: none of its pictures is in .*, such as a_1\.jpg; name the"):
        await take(tmp_path / "labels.json", folder)


async def test_a_picture_twice_in_the_file_is_refused(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON})
    file = tmp_path / "labels.xml"
    image = '<image name="{}a_1.jpg" width="200" height="100"/>\n'
    file.write_text(f"<annotations>{image.format('x/')}{image.format('y/')}</annotations>", encoding="utf-8")
    with pytest.raises(
        LabelsError, match=r"line 2: train/images/a_1\.jpg is there twice, first at .*labels\.xml, line 1"
    ):
        await take(file, folder)


async def test_nobody_has_annotated_anything(tmp_path: Path) -> None:
    folder = every_kind(tmp_path / "site")
    await export(folder, tmp_path / "tasks.json", "label-studio")
    assert await take(tmp_path / "tasks.json", folder) == 1
    assert not record(folder)


async def test_what_is_there_is_not_written_over(tmp_path: Path) -> None:
    folder = every_kind(tmp_path / "site")
    (tmp_path / "tasks.xml").touch()
    with pytest.raises(LabelsError, match=r"tasks\.xml: it is there already; remove it, or name another file"):
        await export(folder, tmp_path / "tasks.json", "label-studio")
    with pytest.raises(LabelsError, match=r"tasks\.xml: it is there already"):
        await export(folder, tmp_path / "tasks.xml", "cvat")
    with pytest.raises(LabelsError, match=r"new\.xml: the labelling interface gets this name; name a file of \.json"):
        await export(folder, tmp_path / "new.xml", "label-studio")
    assert not (tmp_path / "tasks.json").exists()


async def test_labels_that_were_corrected_in_the_folder_itself_stay_and_are_drafts_no_more(tmp_path: Path) -> None:
    folder = every_kind(tmp_path / "site")
    before, boxes = texts(folder), (folder / "boxes_only.txt").read_bytes()
    assert await take(folder, folder) == 0
    assert (texts(folder), (folder / "boxes_only.txt").read_bytes()) == (before, boxes)
    assert [each["file"] for each in record(folder)] == PATHS[:4]


async def test_the_cause_is_named_where_something_cannot_be_written(tmp_path: Path) -> None:
    folder = site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON})
    await export(folder, tmp_path / "labels.json", "coco")
    (folder / "labelled.jsonl").mkdir()
    with pytest.raises(LabelsError, match=r"labelled\.jsonl: Is a directory"):
        await take(tmp_path / "labels.json", folder)


async def test_a_check_shows_what_is_wrong_before_training(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = every_kind(tmp_path / "site")
    settings = LabelsSettings(task="check", source=folder)
    assert await run(settings) == 1
    assert capsys.readouterr().out.splitlines() == [
        f"{folder}: 5 pictures",
        f"train: 3 pictures, 3 objects (1 box, 1 pallet, 1 {NAMES[2]})",
        f"val: 2 pictures, 2 objects (0 box, 1 pallet, 1 {NAMES[2]})",
        f"test: 0 pictures, 0 objects (0 box, 0 pallet, 0 {NAMES[2]})",
        f"4 with drafts: {', '.join(PATHS[:3])} and 1 more",
        f"1 without labels: {PATHS[4]}",
    ]
    await export(folder, tmp_path / "a.xml", "cvat")
    await take(tmp_path / "a.xml", folder)
    labels(folder, "train/images/lost.jpg", POLYGON)
    labels(folder, "train/images/r1-front_1.jpg", "x")
    capsys.readouterr()
    assert await run(settings) == 1
    assert capsys.readouterr().out.splitlines()[4:] == [
        "5 labelled",
        "1 file of labels without a picture: train/labels/lost.txt",
        (
            f"{folder}/train/labels/r1-front_1.txt, line 1: not the number of a class and a polygon or box; correct or"
            " remove it"
        ),
    ]
    labels(folder, "train/images/r1-front_1.jpg", "")
    (folder / "train/labels/lost.txt").unlink()
    assert await run(settings) == 0


def test_the_command(tmp_path: Path) -> None:
    site(tmp_path / "site", {"train/images/a_1.jpg": POLYGON})

    def called(*arguments: str) -> tuple[int, str, str]:
        command = [sys.executable, "-m", "services.toolbox", "labels", *arguments]
        ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=60)
        return ended.returncode, ended.stdout, ended.stderr

    assert called("export", "site", "a.json", "--to", "coco")[0] == 0
    assert called("import", "a.json", "site", "--from", "cvat") == (
        2,
        "",
        "fleetsight labels: a.json, line 1: not XML; it may have been cut off: export it again\n",
    )
    code, out, _ = called("import", "a.json", "site")
    assert (code, out.splitlines()[0]) == (0, f"site: 1 picture labelled, 1 object (1 box, 0 pallet, 0 {NAMES[2]})")
    labels(tmp_path / "site", "train/images/a_1.jpg", "7 0 0 1 0 1 1\n")
    assert called("export", "site", "b.json", "--to", "coco")[2] == (
        "fleetsight labels: site/train/labels/a_1.txt, line 1: no class has the number 7; there are 3: box, pallet,"
        f" {NAMES[2]}\n"
    )
