"""Files of unknown form, damaged and hostile ones."""

import random
import re
import tracemalloc
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from services.toolbox.labels import source
from services.toolbox.labels.objects import LabelsError
from services.toolbox.labels.settings import Form
from services.toolbox.labels.source import read_source
from tests.fuzz.mutation import mutate
from tests.services.toolbox.labels.making import POLYGON, every_kind, export

CVAT = '<annotations><image name="a_1.jpg" width="9" height="9"/></annotations>'
COCO = '{"images": [{"id": 1, "file_name": "a_1.jpg", "width": 9, "height": 9}], "categories": [], "annotations": []}'
ODD = [b"1e308", b"-1", b"1e400", b"9" * 400, b"0", b"NaN", b"inf", b"null", b"[]", b'"x"', b"1.5", b"1e-320"]
TASKS = '[{"data": {"image": "a_1.jpg"}}]'


def archive(file: Path, members: Mapping[str, str]) -> Path:
    """Write an archive."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made:
        for name, text in members.items():
            made.writestr(name, text)
    return file


@pytest.mark.parametrize(
    ("text", "form"),
    [
        (CVAT, Form.CVAT),
        (COCO, Form.COCO),
        (TASKS, Form.LABEL_STUDIO),
        (f"\ufeff\n {COCO}", Form.COCO),
        (f"\ufeff{CVAT}", Form.CVAT),
    ],
)
def test_the_form_is_told_by_the_content(text: str, form: Form, tmp_path: Path) -> None:
    file = tmp_path / "export.txt"
    file.write_text(text, encoding="utf-8")
    found, (labels,) = read_source(file, None)
    assert found is form
    assert (labels.name, labels.place.partition(",")[0].partition(": ")[0]) == ("a_1.jpg", str(file))


def test_archives_and_folders(tmp_path: Path) -> None:
    yolo = {"data.yaml": "names: [box]", "labels/a_1.txt": POLYGON, "notes.json": "{}"}
    assert read_source(archive(tmp_path / "1.zip", yolo), None)[0] is Form.YOLO
    with zipfile.ZipFile(tmp_path / "1.zip") as made:
        made.extractall(tmp_path / "1")
    form, (labels,) = read_source(tmp_path / "1", None)
    assert (form, labels.place) == (Form.YOLO, f"{tmp_path}/1: labels/a_1.txt")
    two = archive(tmp_path / "2.zip", {"annotations/a.json": COCO, "annotations/b.json": COCO, "data.txt": ""})
    form, found = read_source(two, None)
    assert (form, [each.place for each in found]) == (
        Form.COCO,
        [f"{two}: annotations/{name}.json: images[0]" for name in "ab"],
    )


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (
            lambda file: file.write_text("hello"),
            "neither JSON nor XML; export COCO, CVAT for images 1.1, JSON of Label",
        ),
        (lambda file: file.write_bytes(b""), "neither JSON nor XML"),
        (Path.exists, "no such file; name what the labelling tool exported"),
        (lambda file: file.mkdir(), "no labels of a known form are in it; name what the tool exported"),
        (lambda file: archive(file, {"a.jpg": ""}), "no labels of a known form are in it"),
        (
            lambda file: archive(file, {"a.json": COCO, "b.xml": CVAT}),
            "several forms are in it: coco, cvat; name a file",
        ),
        (lambda file: archive(file, {"labels/a.txt": POLYGON}), "no data.yaml or classes.txt names the classes"),
    ],
)
def test_what_is_of_no_form_is_refused(make: Callable[[Path], object], reason: str, tmp_path: Path) -> None:
    file = tmp_path / "export"
    make(file)
    with pytest.raises(LabelsError) as caught:
        read_source(file, None)
    assert str(caught.value).startswith(f"{file}: {reason}")


def test_a_form_that_is_forced_is_the_one(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(COCO)
    with pytest.raises(LabelsError, match=r"expected `array`, got `object`; export it again, as JSON of Label Studio"):
        read_source(tmp_path / "a.json", Form.LABEL_STUDIO)
    with pytest.raises(LabelsError, match=r"no data\.yaml or classes\.txt names the classes"):
        read_source(tmp_path / "a.json", Form.YOLO)


def test_text_that_is_not_utf_8(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as made:
        made.writestr("data.yaml", "names: [box]")
        made.writestr("labels/a.txt", b"\xff\xfe")
    with pytest.raises(LabelsError, match=r"a\.zip: labels/a\.txt: not UTF-8"):
        read_source(tmp_path / "a.zip", None)


def test_an_archive_that_unpacks_to_too_much_is_left_before_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(source, "MAX_BYTES", 4 << 20)
    file = tmp_path / "bomb.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made, made.open("annotations.xml", "w") as member:
        for _ in range(64):
            member.write(bytes(1 << 20))
    assert file.stat().st_size < 1 << 17
    tracemalloc.start()
    try:
        with pytest.raises(LabelsError, match=r"annotations\.xml: more than 4 MiB of labels; import it in parts"):
            read_source(file, None)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_members_together_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "MAX_MEMBERS", 3)
    file = archive(tmp_path / "a.zip", {f"labels/{n}.txt": "" for n in range(4)})
    with pytest.raises(LabelsError, match="more than 3 files are in it; import it in parts"):
        read_source(file, None)


def test_names_in_an_archive_are_never_paths_here(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    file = archive(tmp_path / "in" / "a.zip", {"data.yaml": "names: [box]"})
    with zipfile.ZipFile(file, "a") as made:
        made.writestr("../../labels/a_1.txt", POLYGON)
        made.writestr("/labels/../etc/labels/b_1.txt", POLYGON)
    _, found = read_source(file, None)
    assert sorted(each.name for each in found) == ["a_1", "b_1"]
    assert [each.name for each in tmp_path.rglob("*")] == ["in", "a.zip"]


@pytest.mark.parametrize("spoil", [lambda data: data[:-30], lambda data: data[:40] + b"\0" * 20 + data[60:]])
def test_damaged_archives(spoil: Callable[[bytes], bytes], tmp_path: Path) -> None:
    file = archive(tmp_path / "a.zip", {"annotations.xml": CVAT * 100})
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(LabelsError, match=r"a\.zip: "):
        read_source(file, None)


@pytest.mark.parametrize("form", ["coco", "cvat", "label-studio", "yolo"])
async def test_spoilt_files_are_read_or_refused_and_nothing_else(form: str, tmp_path: Path) -> None:
    folder, file = every_kind(tmp_path / "site"), tmp_path / "seed"
    if form == "yolo":
        archive(file, {"data.yaml": "names: [a, b, c]", "labels/a.txt": POLYGON})
    else:
        await export(folder, file, form)
    content = file.read_bytes()
    if form == "label-studio":
        content = content.replace(b'"predictions"', b'"annotations"').replace(b'"model_version"', b'"x"')
    rng, refused = random.Random(1), 0  # noqa: S311 - the same each time
    for _ in range(300):
        file.write_bytes(mutate(rng, [re.sub(rb"\d+", lambda number: _odd(rng, number[0]), content)]))
        try:
            read_source(file, None)
        except LabelsError:
            refused += 1
    assert 100 < refused < 300


def _odd(rng: random.Random, number: bytes) -> bytes:
    """Return a number, or seldom something that is none or far from it."""
    return rng.choice(ODD) if rng.random() < 0.005 else number
