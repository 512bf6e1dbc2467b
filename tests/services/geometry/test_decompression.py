import pytest
from backports import zstd

from services.geometry.decompression import decompressed
from services.geometry.errors import PayloadError

DATA = bytes(range(100))


def test_what_was_compressed_is_back() -> None:
    assert decompressed(memoryview(zstd.compress(DATA)), 100).tobytes() == DATA


@pytest.mark.parametrize(
    "damaged",
    [
        zstd.compress(DATA)[:-1],
        zstd.compress(DATA) + b"x",
        zstd.compress(DATA + b"x"),
        zstd.compress(DATA[:-1]),
        b"garbage",
        b"",
        zstd.compress(bytes(50_000_000)),
    ],
)
def test_anything_else_is_damaged(damaged: bytes) -> None:
    with pytest.raises(PayloadError, match="zstd that cannot be decoded"):
        decompressed(memoryview(damaged), 100)
