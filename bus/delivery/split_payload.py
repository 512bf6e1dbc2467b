"""A payload in pieces: a head and a tail around a large body that stays in its memory.

Pure but for the addresses of memory, which tell what is around a part of it.
"""

from ctypes import addressof, c_char
from dataclasses import dataclass
from typing import Protocol


class Room(Protocol):
    """Memory that can be written from whole bytes and bytearrays, not from views."""

    def __setitem__(self, item: slice, value: bytes | bytearray, /) -> None: ...


@dataclass(frozen=True, slots=True)
class Pieces:
    """A payload of head, body and tail. body: contiguous."""

    head: bytes
    body: memoryview
    tail: bytes = b""

    def __len__(self) -> int:
        return len(self.head) + self.body.nbytes + len(self.tail)

    def __bytes__(self) -> bytes:
        return b"".join((self.head, self.body, self.tail))

    def write(self, room: Room) -> None:
        """Write the payload to the beginning of a room, without an intermediate copy where possible.

        That is where the body is part of a bytearray, as in a message that is passed on: all of that is written, and
        head and tail over what was around the body.
        """
        size = len(self)
        around = self._around()
        if around is None:
            room[0:size] = bytes(self)
            return
        whole, before = around
        begin = len(self.head) - before
        room[begin : begin + len(whole)] = whole
        room[0 : len(self.head)] = self.head
        if self.tail:
            room[size - len(self.tail) : size] = self.tail

    def _around(self) -> tuple[bytearray, int] | None:
        """Return the bytearray around the body and the bytes before it, if head and tail cover the rest of it."""
        whole = self.body.obj
        if not isinstance(whole, bytearray) or self.body.readonly or not self.body.nbytes:
            return None
        before = _address(self.body) - _address(whole)
        after = len(whole) - before - self.body.nbytes
        return (whole, before) if before <= len(self.head) and after <= len(self.tail) else None


def _address(memory: memoryview | bytearray) -> int:
    return addressof(c_char.from_buffer(memory))


Payload = bytes | bytearray | Pieces
"""Payload types that can be published."""


def joined(payload: Payload) -> bytes | bytearray:
    """Return a payload in one piece."""
    return bytes(payload) if isinstance(payload, Pieces) else payload
