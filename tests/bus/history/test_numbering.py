"""Which message of which publisher a sample is, on a real session."""

from collections.abc import Iterator

import pytest
import zenoh
from zenoh import ext

from bus.history.numbering import cache_key, is_of, is_sent_again, owner_of, place_of, stamp, stamp_of

KEY = "fleet/r1/front/classes"
NUMBERED = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None)


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with zenoh.open(zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}}')) as opened:
        yield opened


def sent(session: zenoh.Session, attachment: bytes | None = None) -> zenoh.Sample:
    """Return a message of a publisher that numbers none."""
    with session.declare_subscriber(KEY) as subscriber:
        session.put(KEY, b"x", attachment=attachment)
        return subscriber.recv()


def test_a_stamp_is_read_as_it_was_written(session: zenoh.Session) -> None:
    sample = sent(session, stamp(2**32 - 1, 2**40))
    assert stamp_of(sample) == (2**32 - 1, 2**40, False)
    assert not is_sent_again(sample)


def test_what_an_earlier_release_sent_again_is_told_from_what_is_new(session: zenoh.Session) -> None:
    sample = sent(session, stamp(7, 9)[:-2] + b"\x00\x03")
    assert stamp_of(sample) == (7, 9, True)
    assert is_sent_again(sample)


@pytest.mark.parametrize("attachment", [None, b"", b"of another program", b"\x00" * len(stamp(1, 1))])
def test_what_others_attach_is_no_stamp(session: zenoh.Session, attachment: bytes | None) -> None:
    sample = sent(session, attachment)
    assert stamp_of(sample) is None
    assert not is_sent_again(sample)


def test_other_programs_advanced_publishers_have_the_numbers_of_zenoh(session: zenoh.Session) -> None:
    publisher = ext.declare_advanced_publisher(session, KEY, sample_miss_detection=NUMBERED)
    with session.declare_subscriber(KEY) as subscriber:
        for _ in range(2):
            publisher.put(b"x")
        samples = [subscriber.recv(), subscriber.recv()]
    assert [stamp_of(sample) for sample in samples] == [(place_of(publisher.id), number, False) for number in (0, 1)]
    publisher.undeclare()


def test_a_cache_says_whose_it_is(session: zenoh.Session) -> None:
    publisher = ext.declare_advanced_publisher(
        session,
        KEY,
        cache=ext.CacheConfig(1),
        sample_miss_detection=NUMBERED,
        publisher_detection=True,
    )
    tokens = [reply.ok for reply in session.liveliness().get(f"{KEY}/@adv/**")]
    assert [owner_of(str(token.key_expr)) for token in tokens if token] == [(KEY, place_of(publisher.id))]
    publisher.undeclare()


def test_our_cache_says_so_too() -> None:
    cache = cache_key(KEY, "abc", 2**32 - 1)
    assert owner_of(cache) == (KEY, f"abc/{2**32 - 1}")
    assert is_of(cache, 2**32 - 1)
    assert not is_of(cache, 1)
