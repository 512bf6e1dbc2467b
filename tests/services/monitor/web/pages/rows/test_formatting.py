"""Times, counts and ages as text."""

import pytest

from services.monitor.fleet import Age
from services.monitor.web.pages.rows.formatting import NS, age_text, ago, brief, iso, lasting, plural, rate_text


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0, "0 s"),
        (0.9, "0 s"),
        (1, "1 s"),
        (59.9, "59 s"),
        (60, "1 min"),
        (3_600, "1 h"),
        (86_399, "23 h"),
        (2e5, "2 d"),
    ],
)
def test_a_duration_is_said_in_its_largest_unit(seconds: float, said: str) -> None:
    assert lasting(seconds) == said


def test_what_was_never_is_not_long_ago_and_what_is_to_come_is_now() -> None:
    assert ago(0, 10 * NS) == "never"
    assert ago(10 * NS, 10 * NS + NS - 1) == "now"
    assert ago(9 * NS, 10 * NS) == "1 s ago"
    assert ago(20 * NS, 10 * NS) == "now"


def test_an_age_is_exact_to_a_tenth_while_it_is_small() -> None:
    assert age_text(None) == "\N{EN DASH}"
    assert age_text(Age(0.25, exact=True)) == "0.2 s"
    assert age_text(Age(9.94, exact=False)) == "> 9.9 s"
    assert age_text(Age(10.0, exact=True)) == "10 s"
    assert age_text(Age(120.0, exact=False)) == "> 2 min"


@pytest.mark.parametrize(
    ("count", "said"), [(0, "0"), (999, "999"), (1_000, "1.0k"), (9_960, "10k"), (999_000, "999k"), (2_500_000, "2.5M")]
)
def test_counts_are_brief(count: int, said: str) -> None:
    assert brief(count) == said


def test_rates_and_nouns() -> None:
    assert (rate_text(0), rate_text(2)) == ("\N{EN DASH}", "2.0/s")
    assert (plural(1, "camera"), plural(1_200, "class", "classes")) == ("1 camera", "1,200 classes")


def test_times_are_iso_in_utc() -> None:
    assert iso(0) == ""
    assert iso(1_500_000_000) == "1970-01-01T00:00:01.500+00:00"
