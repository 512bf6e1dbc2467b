"""A data-set folder that grows: pictures, labels, names of classes, and where each picture is from."""

import json
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from schemas.detections import Detections
from schemas.keys import CameraKey
from schemas.printing import printable
from services.data_folder import COLLECTED, NAMES, SPLITS, DatasetError, cut_torn, labels_of, names_in, write_names
from services.toolbox.collect.pictures import Picture, labels
from services.whole_file import write_whole


@dataclass(slots=True)
class Dataset:
    """A folder in the form that Ultralytics and `fleetsight train` read.

    names: of the classes, in the order of their numbers in labels. count, size: of the pictures collected so far, in
    bytes.
    """

    folder: Path
    names: list[str]
    count: int = 0
    size: int = 0
    _fingerprints: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))

    @classmethod
    def open(cls, folder: Path, names: list[str]) -> "Dataset":
        """Make the folder, or read what was collected in it before. Its own names come before those given.

        Raises:
            DatasetError: it cannot be made or read.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / NAMES).exists() and not (folder / COLLECTED).exists():
                of_another = f"a data set of another tool, whose {NAMES} would change; name another folder"
                raise DatasetError(f"{printable(str(folder))}: {of_another}")
            known = names_in(folder / NAMES)
            dataset = cls(folder, [*known, *(name for name in dict.fromkeys(names) if name not in known)])
            dataset._read_record()
            (folder / COLLECTED).touch()
            dataset._write_names()
        except OSError as error:
            raise DatasetError(f"{printable(str(error.filename or folder))}: {error.strerror}") from error
        return dataset

    def is_known(self, camera: CameraKey, fingerprint: int, least_difference: int) -> bool:
        """Return whether a picture of the camera was saved that differs in fewer bits."""
        saved = self._fingerprints.get(str(camera), ())
        return any((fingerprint ^ each).bit_count() < least_difference for each in saved)

    def save(self, picture: Picture, why: str, found: Detections | None, split: str, hidden: tuple[str, ...]) -> Path:
        """Write a picture, the drafts of its labels if there are any, and a line about both; return its file.

        hidden: classes that are blurred wherever they are found, and so have no labels. A picture that is half written
        when the process dies has no line in the record.

        Raises:
            OSError: the disk is full, or the folder gone.
        """
        header = picture.frame.header
        source = f"{header.robot}-{header.camera}".replace("_", "-")
        file = self.folder / split / "images" / f"{source}_{header.stamp_ns}.jpg"
        write_whole(file, picture.file)
        about: dict[str, Any] = {
            "file": str(file.relative_to(self.folder)),
            "robot": header.robot,
            "camera": header.camera,
            "boot_id": header.boot_id,
            "seq": header.seq,
            "stamp_ns": header.stamp_ns,
            "why": why,
            "fingerprint": f"{picture.fingerprint:016x}",
            "bytes": len(picture.file),
            "blurred": list(picture.blurred),
        }
        if found is not None:
            self._learn(each.name for each in found.objects if each.name not in hidden)
            codes = {name: code for code, name in enumerate(self.names) if name not in hidden}
            write_whole(labels_of(file), "".join(labels(found, codes)).encode())
            about |= {"drafts_by": found.model, "worker": found.worker}
        with (self.folder / COLLECTED).open("a", encoding="utf-8") as record:
            record.write(json.dumps(about) + "\n")
        self._note(about)
        return file

    def _learn(self, names: Any) -> None:
        new = [name for name in dict.fromkeys(names) if name not in self.names]
        if new:
            self.names.extend(new)
            self._write_names()

    def _write_names(self) -> None:
        folders = {split: f"{split}/images" for split in SPLITS}
        write_names(self.folder / NAMES, self.names, path=str(self.folder.resolve()), **folders)

    def _read_record(self) -> None:
        record = self.folder / COLLECTED
        cut_torn(record)
        lines = record.read_text(encoding="utf-8").splitlines() if record.exists() else []
        for number, line in enumerate(lines, 1):
            try:
                self._note(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                raise DatasetError(f"{printable(str(record))}: line {number} is damaged; remove it") from error

    def _note(self, about: dict[str, Any]) -> None:
        fingerprint, size = int(about["fingerprint"], 16), int(about["bytes"])
        self._fingerprints[str(CameraKey(about["robot"], about["camera"]))].append(fingerprint)
        self.count += 1
        self.size += size
