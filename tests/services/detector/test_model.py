import pytest

from services.detector.model import first_line


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (RuntimeError("\n the device is lost \nat 0x7f"), "the device is lost"),
        (RuntimeError(), "RuntimeError"),
        (KeyError(101), "KeyError: 101"),
        (KeyError("model"), "KeyError: 'model'"),
        (RuntimeError("Exception from src/core.cpp:105:\nCheck failed:\nno such file\nat all"), "no such file"),
        (RuntimeError("Exception from src/core.cpp:105:\n"), "Exception from src/core.cpp:105:"),
    ],
)
def test_an_error_is_said_in_words(error: Exception, said: str) -> None:
    assert first_line(error) == said
