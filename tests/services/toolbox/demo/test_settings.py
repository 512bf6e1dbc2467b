from pathlib import Path

import pytest
from pydantic import ValidationError

from services.toolbox.demo.settings import DemoSettings


def test_a_model_that_is_not_there_is_refused_before_anything_starts(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=r"nope\.pt: no such file"):
        DemoSettings(model=str(tmp_path / "nope.pt"))
