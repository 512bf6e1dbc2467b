"""Decompresses data from a gateway."""

import sys

from services.geometry.errors import PayloadError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


def decompressed(data: memoryview, size: int) -> memoryview:
    """Return the `size` bytes of one Zstandard frame; never decompresses more.

    Raises:
        PayloadError: it does not hold them.
    """
    decoder = zstd.ZstdDecompressor()
    try:
        held = decoder.decompress(data, size + 1)
    except zstd.ZstdError as error:
        raise PayloadError(f"a zstd that cannot be decoded: {error}") from error
    if len(held) != size or not decoder.eof or decoder.unused_data:
        raise PayloadError("a zstd that cannot be decoded")
    return memoryview(held)
