"""Spoils good bytes in the ways that hostile, broken and half-closed peers do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from random import Random
    from typing import TypeAlias

    Operation: TypeAlias = Callable[[Random, bytearray, Sequence[bytes]], None]

MAX_BYTES: Final = 64 << 10
_HOW_OFTEN: Final = (1, 1, 1, 2, 2, 3, 5, 8)
_LENGTHS: Final = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0xFFFF, 1 << 20, 1 << 24, 0x7FFFFFFF, 1 << 31, 0xFFFFFFFF)
_BYTES: Final = b"\x00\x01\x20\x2f\x3c\x3d\x7f\x80\xc0\xc1\xff"
_MAX_COPIES: Final = 64


def mutate(rng: Random, seeds: Sequence[bytes]) -> bytes:
    """Return one of the seeds with a few things wrong."""
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.choice(_HOW_OFTEN)):
        rng.choice(OPERATIONS)(rng, data, seeds)
    return bytes(data[:MAX_BYTES])


def pieces(rng: Random, data: bytes) -> list[bytes]:
    """Return the data cut as a network may cut it, sometimes into single bytes."""
    if len(data) < 100 and rng.random() < 0.1:
        return [data[i : i + 1] for i in range(len(data))]
    cuts = sorted(rng.randrange(len(data) + 1) for _ in range(rng.randrange(4)))
    return [data[start:end] for start, end in zip([0, *cuts], [*cuts, len(data)], strict=True)]


def _part(rng: Random, size: int, longest: int) -> tuple[int, int]:
    start = rng.randrange(size + 1)
    return start, min(size, start + rng.randrange(longest + 1))


def flip_a_bit(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def set_a_byte(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    if data:
        data[rng.randrange(len(data))] = rng.choice(_BYTES) if rng.random() < 0.5 else rng.randrange(256)


def cut_off(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    del data[rng.randrange(len(data) + 1) :]


def cut_out(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    start, end = _part(rng, len(data), 16)
    del data[start:end]


def put_in(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.randbytes(rng.randrange(1, 9))


def repeat(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    """Repeat a part, as a flood of headers or a nesting does."""
    start, end = _part(rng, len(data), 64)
    data[start:start] = data[start:end] * rng.randrange(1, _MAX_COPIES)


def splice(rng: Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    """Go on with the end of another seed."""
    other = rng.choice(seeds)
    del data[rng.randrange(len(data) + 1) :]
    data += other[rng.randrange(len(other) + 1) :]


def lie_about_a_length(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    if len(data) >= 4:
        at = rng.randrange(len(data) - 3)
        length = rng.choice(_LENGTHS) if rng.random() < 0.7 else len(data) - at - 4 + rng.randrange(-4, 5)
        data[at : at + 4] = (length % (1 << 32)).to_bytes(4, "little" if rng.random() < 0.8 else "big")


def lie_about_a_number(rng: Random, data: bytearray, _seeds: Sequence[bytes]) -> None:
    """Replace the first digits after a random place."""
    start = rng.randrange(len(data) + 1)
    while start < len(data) and not 0x30 <= data[start] <= 0x39:
        start += 1
    end = start
    while end < len(data) and 0x30 <= data[end] <= 0x39:
        end += 1
    if end > start:
        data[start:end] = str(rng.choice(_LENGTHS) * rng.choice((-1, 1, 1, 1 << 40))).encode()


OPERATIONS: Final[tuple[Operation, ...]] = (
    flip_a_bit,
    set_a_byte,
    cut_off,
    cut_out,
    put_in,
    repeat,
    splice,
    lie_about_a_length,
    lie_about_a_length,
    lie_about_a_number,
)
