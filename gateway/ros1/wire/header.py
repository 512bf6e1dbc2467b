"""TCPROS connection headers: length-prefixed `key=value` fields."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from gateway.ros1.errors import HeaderError

if TYPE_CHECKING:
    from collections.abc import Mapping

LENGTH = struct.Struct("<I")
MAX_HEADER_BYTES = 1 << 20
MAX_FIELDS = 64


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return the header with its length prefix.

    Raises:
        HeaderError: a key is empty or holds `=`, or the header is over a limit.

    """
    if len(fields) > MAX_FIELDS:
        raise HeaderError(f"{len(fields)} fields, over the limit of {MAX_FIELDS}")
    body = b"".join(_encode_field(key, value) for key, value in fields.items())
    if len(body) > MAX_HEADER_BYTES:
        raise HeaderError(f"header of {len(body)} bytes, over the limit of {MAX_HEADER_BYTES}")
    return LENGTH.pack(len(body)) + body


def _encode_field(key: str, value: str) -> bytes:
    if not key or "=" in key:
        raise HeaderError(f"illegal key {key!r}")
    try:
        field = f"{key}={value}".encode()
    except UnicodeEncodeError as error:
        raise HeaderError(f"field {key!r} is not text") from error
    return LENGTH.pack(len(field)) + field


def decode_header(body: bytes | bytearray | memoryview) -> dict[str, str]:
    """Return the fields of a header given without its own length prefix; the last of equal keys counts.

    Bytes of a value that are not UTF-8, as in comments of old message definitions, become U+FFFD.

    Raises:
        HeaderError: a length points outside, a field has no `=`, no key or one that is not UTF-8, or a limit is passed.

    """
    if len(body) > MAX_HEADER_BYTES:
        raise HeaderError(f"header of {len(body)} bytes, over the limit of {MAX_HEADER_BYTES}")
    fields: dict[str, str] = {}
    view, position, count = memoryview(body), 0, 0
    while position < len(view):
        count += 1
        if count > MAX_FIELDS:
            raise HeaderError(f"over the limit of {MAX_FIELDS} fields")
        end = _field_end(view, position)
        key, value = _decode_field(view[position + LENGTH.size : end])
        fields[key] = value
        position = end
    return fields


def _field_end(view: memoryview, position: int) -> int:
    if len(view) - position < LENGTH.size:
        raise HeaderError("cut off in a field's length")
    (length,) = LENGTH.unpack_from(view, position)
    end: int = position + LENGTH.size + length
    if end > len(view):
        raise HeaderError(f"field of {length} bytes reaches past the end")
    return end


def _decode_field(field: memoryview) -> tuple[str, str]:
    key, separator, value = bytes(field).partition(b"=")
    if not separator or not key:
        raise HeaderError(f"field without key and value: {key[:80]!r}")
    try:
        return str(key, "utf-8"), str(value, "utf-8", "replace")
    except UnicodeDecodeError as error:
        raise HeaderError("key is not UTF-8") from error
