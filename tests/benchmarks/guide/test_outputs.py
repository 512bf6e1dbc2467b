from benchmarks.guide.outputs import FLEETSIGHT, GUIDE, stamp_ns, stamped
from gateway.ros1.image import TYPE_NAME, Image, decode_image, encode_image
from gateway.to_ros.outputs import RESULTS, STRING, string

IMAGE = encode_image(
    Image(
        seq=7,
        stamp_s=5,
        stamp_ns=6,
        frame_id="camera",
        height=1,
        width=1,
        encoding="rgb8",
        is_bigendian=False,
        step=3,
        data=memoryview(b"abc"),
    )
)


def test_another_stamp_and_nothing_else() -> None:
    now_ns = 1_795_000_000_123_456_789
    message = stamped(IMAGE, now_ns)
    assert len(message) == len(IMAGE)
    found = decode_image(message)
    assert (found.stamp, found.seq, found.frame_id, bytes(found.data)) == (now_ns, 7, "camera", b"abc")
    assert stamp_ns(TYPE_NAME, message) == now_ns
    assert stamp_ns(TYPE_NAME, IMAGE) == 5_000_000_006


def test_texts_have_no_stamp() -> None:
    assert stamp_ns(STRING, string("['box']")) == 0


def test_fleetsight_gives_a_whole_set_and_the_guide_as_many() -> None:
    assert set(FLEETSIGHT) == {f"/ultralytics/{name}" for name in RESULTS.values()}
    assert len(GUIDE) == len(FLEETSIGHT)
