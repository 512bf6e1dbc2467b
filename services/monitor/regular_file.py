"""Files that are read whole: from a pipe that nobody writes to they would be waited for, for ever."""

import os
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator


def _regular(path: Path) -> Path:
    """Refuse what is there and is no regular file; whoever reads it says that it is not there."""
    if os.path.exists(path) and not os.path.isfile(path):  # noqa: PTH110, PTH113 - these raise nothing
        raise ValueError("no regular file")
    return path


RegularFile = Annotated[Path, AfterValidator(_regular)]
