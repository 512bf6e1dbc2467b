import pytest
from pydantic import ValidationError

from services.toolbox.clouds.settings import CloudsSettings


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"camera": "tf"}, "reserved"),
        ({"robot": "a b"}, "robot name"),
        ({"formats": []}, "formats"),
        ({"do": "eat"}, "do"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        CloudsSettings.model_validate({"do": "view", "robot": "r1", "camera": "front", **changes})
