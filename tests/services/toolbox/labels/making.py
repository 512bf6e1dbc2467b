"""Folders of pictures and labels for tests."""

import json
from pathlib import Path
from typing import Final

import yaml
from PIL import Image

from services.toolbox.labels.process import run
from services.toolbox.labels.settings import LabelsSettings

WIDTH: Final = 200
HEIGHT: Final = 100
NAMES: Final = ("box", "pallet", "Stapler ü/&<'\">")
POLYGON: Final = "0 0.10000 0.10000 0.50000 0.10000 0.30000 0.80000\n"
SQUARE: Final = "1 0.20000 0.20000 0.60000 0.20000 0.60000 0.70000 0.20000 0.70000\n"
MANY: Final = "2 0.05000 0.05000 0.95000 0.05123 0.90001 0.33333 0.50000 0.99999 0.00000 0.50000\n"


def picture(file: Path, size: tuple[int, int] = (WIDTH, HEIGHT), orientation: int = 1) -> Path:
    """Write a grey picture of this width and height, with an orientation in its EXIF data."""
    file.parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.new("RGB", size, "grey").save(file, exif=exif)
    return file


def labels(folder: Path, path: str, text: str) -> Path:
    """Write the labels of a picture."""
    split, _, name = path.split("/")
    file = folder / split / "labels" / f"{Path(name).stem}.txt"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return file


def site(folder: Path, pictures: dict[str, str | None]) -> Path:
    """Make a folder of pictures with these drafts of labels; None is none."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {"path": "/elsewhere", "train": "train/images", "names": dict(enumerate(NAMES))}
    (folder / "data.yaml").write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    with (folder / "collected.jsonl").open("w", encoding="utf-8") as record:
        for path, text in pictures.items():
            picture(folder / path)
            about = {"file": path, "robot": "r1", "camera": "front", "fingerprint": "0", "bytes": 1}
            if text is not None:
                labels(folder, path, text)
                about["drafts_by"] = "warehouse.pt"
            record.write(json.dumps(about) + "\n")
    return folder


def every_kind(folder: Path) -> Path:
    """Make a folder of two splits, odd names, an empty picture and one without labels."""
    found = site(
        folder,
        {
            "train/images/r1-front_1.jpg": POLYGON + SQUARE,
            "train/images/Lager ü #3 50%_&'2'.png": MANY,
            "train/images/nothing_1.jpeg": "",
            "val/images/r2.front_9.JPG": SQUARE + MANY,
            "val/images/unlabelled_1.jpg": None,
        },
    )
    (found / "boxes_only.txt").write_text("val/images/r2.front_9.JPG\n", encoding="utf-8")
    return found


def texts(folder: Path) -> dict[str, str]:
    """Return all labels of a folder by the names of their files."""
    return {file.name: file.read_text(encoding="utf-8") for file in sorted(folder.glob("*/labels/*.txt"))}


def record(folder: Path) -> list[dict[str, object]]:
    """Return what labelled.jsonl says."""
    return [json.loads(line) for line in (folder / "labelled.jsonl").read_text(encoding="utf-8").splitlines()]


async def export(folder: Path, target: Path, to: str) -> None:
    """Export labels."""
    settings = LabelsSettings.model_validate({"task": "export", "source": folder, "target": target, "to": to})
    assert await run(settings) == 0


async def take(file: Path, folder: Path, *, leave_empty: bool = False) -> int:
    """Import labels; return the exit code."""
    return await run(LabelsSettings(task="import", source=file, target=folder, leave_empty=leave_empty))
