"""Which actions were done, also by the process before this one: their ids, in a file."""

import json
import logging
import os
from collections import OrderedDict
from pathlib import Path
from typing import Final

FILE: Final = "done-actions"
MOST: Final = 10_000
"""Ids that are remembered, the latest ones; the file has at most twice as many, a line each."""

log = logging.getLogger(__name__)


def state_folder() -> Path | None:
    """Return the folder that systemd's StateDirectory= or whoever starts the process gives it, if any."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return Path(given) if given else None


class DoneActions:
    """The ids of actions that a robot has done. Errors in reading or writing the file are logged; the robot goes on.

    folder: where the robot's file is; None remembers nothing beyond the process.
    """

    def __init__(self, folder: Path | None, robot: str = "") -> None:
        self._file = None if folder is None else folder / f"{FILE}-{robot}.jsonl"
        self._ids: OrderedDict[str, None] = OrderedDict()
        self._lines = 0
        if self._file is not None:
            self._read(self._file)

    def __contains__(self, action: str) -> bool:
        return action in self._ids

    def add(self, action: str) -> None:
        """Note an action that was done."""
        self._note(action)
        if self._file is None:
            return
        try:
            if self._lines >= 2 * MOST:
                self._write_anew(self._file)
            else:
                with self._file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(action) + "\n")
                self._lines += 1
        except OSError as error:
            self._lines = 2 * MOST  # a line may be there in part: the next action writes all of it anew
            log.warning("%s: an action that was done will not be known after a restart: %s", self._file, error.strerror)

    def _read(self, file: Path) -> None:
        try:
            lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
        except FileNotFoundError:
            return
        except OSError as error:
            log.warning("%s: which actions were done is not known: %s", file, error.strerror)
            return
        self._lines = len(lines)
        for line in lines:
            try:
                self._note(str(json.loads(line)))
            except ValueError:  # half written when the disk was full or the power went
                self._lines = 2 * MOST

    def _note(self, action: str) -> None:
        self._ids[action] = None
        self._ids.move_to_end(action)
        if len(self._ids) > MOST:
            self._ids.popitem(last=False)

    def _write_anew(self, file: Path) -> None:
        draft = file.with_suffix(".part")
        with draft.open("w", encoding="utf-8") as written:
            written.writelines(json.dumps(each) + "\n" for each in self._ids)
            written.flush()
            os.fsync(written.fileno())
        draft.replace(file)
        self._lines = len(self._ids)
