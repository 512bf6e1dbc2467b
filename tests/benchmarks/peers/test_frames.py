import time

from benchmarks.peers.frames import HEIGHT, MARK, STEP, frames, sent_ns


def test_frames_are_drawn_anew_and_are_the_same_in_every_run() -> None:
    one, other = frames(b"head"), frames(b"head")
    first, same = bytes(next(one)), bytes(next(other))
    second = bytes(next(one))
    drawn = len(b"head") + len(MARK) + 8
    assert len(first) == len(b"head") + HEIGHT * STEP
    assert first[drawn:] == same[drawn:] != second[drawn:]


def test_a_frame_says_when_it_was_made() -> None:
    before_ns = time.time_ns()
    made = bytes(next(frames()))
    assert made.startswith(MARK)
    assert before_ns <= sent_ns(made) <= time.time_ns()
