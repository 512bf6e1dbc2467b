"""Memory that pieces are written to, for tests."""


class Room:
    """What was written, and in which pieces."""

    def __init__(self, size: int) -> None:
        self.memory = bytearray(size)
        self.written: list[bytes | bytearray] = []

    def __setitem__(self, item: slice, value: bytes | bytearray, /) -> None:
        assert len(self.memory[item]) == len(value)
        self.memory[item] = value
        self.written.append(value)
