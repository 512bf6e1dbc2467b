import pytest

from gateway.ros1.messages import Time, new_message
from gateway.to_bus.translators.stream_kind import label, stamp_of, stamped
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from tests.schemas.frames import header


@pytest.mark.parametrize("seconds", [0, 1, 2**31 - 1, 2**31, 2**32 - 1])
def test_ros_seconds_have_no_sign(seconds: int) -> None:
    about = new_message("std_msgs/Header", seq=0, stamp=Time(seconds, 999_999_999), frame_id="")
    assert stamp_of(about) == seconds * 1_000_000_000 + 999_999_999


def test_a_header_takes_stamp_and_frame_and_cuts_the_frame() -> None:
    made = stamped(header(), 5, "x" * (MAX_LABEL + 1))
    assert (made.stamp_ns, made.frame_id, made.seq) == (5, "x" * MAX_LABEL, header().seq)


def test_a_label_is_never_cut() -> None:
    assert label("frame", "x" * MAX_LABEL) == "x" * MAX_LABEL
    with pytest.raises(SchemaError, match=f"frame with a name of {MAX_LABEL + 1} characters"):
        label("frame", "x" * (MAX_LABEL + 1))
