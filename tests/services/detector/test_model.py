import pytest

from services.detector.model import first_line


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (RuntimeError("\n the device is lost \nat 0x7f"), "the device is lost"),
        (RuntimeError(), "RuntimeError"),
        (KeyError(101), "KeyError: 101"),
        (KeyError("model"), "KeyError: 'model'"),
    ],
)
def test_an_error_is_said_in_words(error: Exception, said: str) -> None:
    assert first_line(error) == said
