from bus.delivery.shared_memory import FRAMES, MAX_REFUSED_PAYLOADS, READER_TIMEOUT_S, SMALLEST_BYTES, SharedFrames
from bus.delivery.split_payload import Pieces

SIZE = 100_000


def test_a_small_payload_is_not_shared() -> None:
    payload = bytes(SMALLEST_BYTES - 1)
    assert SharedFrames().place(payload) is payload


def test_a_large_payload_is_copied() -> None:
    payload = bytearray(range(256)) * (SMALLEST_BYTES // 256)
    placed = SharedFrames().place(payload)
    assert placed is not payload
    assert bytes(placed or b"") == payload


def test_pieces_are_copied_into_one_place() -> None:
    whole = bytearray(range(256)) * (SIZE // 256)
    placed = SharedFrames().place(Pieces(b"a head", memoryview(whole)[3:-2], b"a tail"))
    assert not isinstance(placed, bytes)
    assert bytes(placed or b"") == b"a head" + whole[3:-2] + b"a tail"


def test_pieces_that_are_not_shared_are_joined() -> None:
    assert SharedFrames().place(Pieces(b"a ", memoryview(bytearray(b"small")), b" one")) == b"a small one"


def test_there_is_room_for_so_many_payloads_until_one_is_gone() -> None:
    frames = SharedFrames()
    held = [frames.place(bytes([number]) * SIZE) for number in range(FRAMES)]
    assert None not in held
    assert frames.place(bytes(SIZE)) is None
    del held[0]
    assert bytes(frames.place(b"x" * SIZE) or b"") == b"x" * SIZE


def test_room_grows_with_the_payloads_and_what_is_held_stays_whole() -> None:
    frames = SharedFrames()
    held = [frames.place(bytes([number]) * SIZE) for number in range(FRAMES)]
    held += [frames.place(bytes([number]) * 2 * SIZE) for number in range(FRAMES)]
    assert [bytes(each or b"")[:1] for each in held] == [bytes([number]) for number in range(FRAMES)] * 2
    assert frames.place(bytes(2 * SIZE)) is None


def test_what_is_never_let_go_of_is_left_to_who_holds_it() -> None:
    frames = SharedFrames()
    held = [frames.place(bytes([number]) * SIZE) for number in range(FRAMES)]
    assert [frames.place(bytes(SIZE)) for _ in range(MAX_REFUSED_PAYLOADS - 1)] == [None] * (MAX_REFUSED_PAYLOADS - 1)
    again = [frames.place(b"x" * SIZE) for _ in range(FRAMES)]
    assert [bytes(each or b"")[:1] for each in again] == [b"x"] * FRAMES
    assert [bytes(each or b"")[:1] for each in held] == [bytes([number]) for number in range(FRAMES)]


def test_a_stream_with_few_payloads_does_not_wait_for_thirty_of_them() -> None:
    now = [10.0]
    frames = SharedFrames(lambda: now[0])
    held = [frames.place(bytes(SIZE)) for _ in range(FRAMES)]
    assert frames.place(bytes(SIZE)) is None
    now[0] += 0.99 * READER_TIMEOUT_S
    assert frames.place(bytes(SIZE)) is None
    now[0] = 10.0 + READER_TIMEOUT_S
    assert frames.place(bytes(SIZE)) is not None
    assert None not in held


def test_what_has_room_again_needs_no_other_memory_however_long_ago_it_had_none() -> None:
    now = [10.0]
    frames = SharedFrames(lambda: now[0])
    held = [frames.place(bytes(SIZE)) for _ in range(FRAMES)]
    assert frames.place(bytes(SIZE)) is None
    held.pop()
    now[0] += 2 * READER_TIMEOUT_S
    held.append(frames.place(bytes(SIZE)))
    assert None not in held
    assert frames.place(bytes(SIZE)) is None


def test_payloads_of_any_sizes_find_room_again() -> None:
    frames = SharedFrames()
    held = [frames.place(bytes(SIZE))]
    for number in range(1000):
        held[:] = [frames.place(bytes(SMALLEST_BYTES + number * 7919 % (SIZE - SMALLEST_BYTES)))]
        assert held != [None]


def test_what_the_system_has_no_room_for_is_sent_as_it_is() -> None:
    class Endless(bytes):
        def __len__(self) -> int:
            return 2**62

    payload = Endless()
    assert SharedFrames().place(payload) is payload
