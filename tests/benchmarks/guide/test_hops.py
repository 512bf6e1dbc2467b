import pytest

from benchmarks.guide.hops import HOPS, Limit, Seen, lines, table
from schemas.keys import Stream

MS = 1_000_000


def seen() -> Seen:
    """Return an image whose every hop takes another time."""
    return Seen(
        stamp_ns=1000 * MS,
        received_ns=1002 * MS,
        at_ns={
            Stream.COLOR: 1005 * MS,
            Stream.DETECTIONS: 1090 * MS,
            Stream.CLASSES: 1091 * MS,
            Stream.OVERLAY_DETECTION: 1100 * MS,
            Stream.OVERLAY_SEGMENTATION: 1110 * MS,
        },
        spans={"queue": 1 * MS, "prepare": 2 * MS, "model": 60 * MS, "postprocess": 10 * MS, "distance": 4 * MS},
        told_ns=1094 * MS,
        returned_ns=1113 * MS,
    )


def hops(*frames: Seen, link_ms: float = 1.0, **limits: Limit) -> dict[str, float | None]:
    return {row["hop"]: row["ms"] for row in table(frames, link_ms, limits)}


def test_every_hop_of_one_image() -> None:
    found = hops(seen())
    assert found == {
        "camera": 2,
        "gateway": 2,
        "link": 1,
        "queue": 1,
        "pre-processing": 2,
        "model": 60,
        "post-processing": 10,
        "tracking": None,
        "results": 12,
        "overlays": 20,
        "distance": 4,
        "cloud": None,
        "return to ROS": 3,
        "monitor": 3,
    }


def test_medians_of_those_images_that_have_it() -> None:
    slow, without = seen(), Seen(stamp_ns=5)
    slow.spans["model"] = 100 * MS
    assert hops(seen(), slow, without)["model"] == 80
    assert hops(without)["camera"] is None


def test_no_hop_takes_less_than_nothing() -> None:
    early = seen()
    early.at_ns[Stream.DETECTIONS] = 1006 * MS
    found = hops(early, link_ms=5.0)
    assert (found["gateway"], found["results"], found["link"]) == (0, 0, 5)


def test_ratio_to_the_limit() -> None:
    (row,) = (row for row in table([seen()], 1.0, {"model": Limit("the bare call", 40.0)}) if row["hop"] == "model")
    assert row == {"hop": "model", "ms": 60, "limit": "the bare call", "limit_ms": 40, "ratio": 1.5}
    (row,) = (row for row in table([], 1.0, {"model": Limit("nothing at all", 0.0)}) if row["hop"] == "model")
    assert (row["ms"], row["ratio"]) == (None, None)


def test_a_line_for_each_hop() -> None:
    head, *rows = lines(table([seen()], 1.0, {"model": Limit("the bare call", 40.0)}))
    assert head.split() == ["hop", "ms", "limit", "ratio", "of"]
    assert len(rows) == len(HOPS) + 1
    assert rows[5].split() == ["model", "60.0", "40.0", "1.5", "the", "bare", "call"]
    assert rows[0].split() == ["camera", "2.0", "-", "-", "-"]


@pytest.mark.parametrize("hop", ["queue", "tracking"])
def test_what_has_no_limit_says_why(hop: str) -> None:
    (row,) = (row for row in table([seen()], 1.0, {}) if row["hop"] == hop)
    assert (row["limit_ms"], row["ratio"]) == (None, None)
    assert row["limit"].startswith("no limit: ")
    (line,) = (line for line in lines([row]) if line.startswith(hop))
    assert line.endswith(row["limit"])


@pytest.mark.parametrize("name", HOPS)
def test_of_an_image_that_nobody_saw_nothing_is_known(name: str) -> None:
    assert HOPS[name](Seen(stamp_ns=0)) is None
