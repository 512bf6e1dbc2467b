"""Lost and doubled class lists and alerts are told from those that are neither."""

import pytest

from benchmarks.chaos.accounts import Losses, Published, arrivals, losses, missing


def lists(views: str) -> list[Published]:
    """Return a list for each letter: P with a pallet in view, any other one without."""
    return [Published(f"list-w1-{number}", number, pallet=view == "P") for number, view in enumerate(views)]


def once(published: list[Published]) -> dict[str, int]:
    return {each.mark: 1 for each in published}


def cost(views: str, *, alerts: str = "", pallet_before: bool = False) -> Losses:
    """Return what is lost of lists that are all at the store. alerts: a letter for each new one, O while open."""
    published = lists(views)
    after = {"old": False, **{f"new{number}": state == "O" for number, state in enumerate(alerts)}}
    return losses(published, once(published), {"old"}, after, pallet_before=pallet_before)


def test_a_line_of_a_journal_is_read_as_it_was_written() -> None:
    for published in lists(".P"):
        assert Published.read(published.line()) == published


def test_a_line_that_a_killed_worker_did_not_finish_is_none() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        Published.read("list-w1-1 17")


@pytest.mark.parametrize(
    ("views", "before", "expected"),
    [("", False, 0), ("..PP..P", False, 2), ("PP..", False, 1), ("PP..", True, 0), ("PP..P", True, 1)],
)
def test_a_pallet_arrives_where_there_was_none(views: str, before: bool, expected: int) -> None:  # noqa: FBT001
    assert arrivals(lists(views), before=before) == expected


def test_nothing_is_lost_where_each_list_has_a_row_and_each_arrival_an_alert() -> None:
    assert cost("..PP..P", alerts="RO").figures() == {
        "lost": 0,
        "doubled": 0,
        "lists": 7,
        "lost_lists": 0,
        "doubled_lists": 0,
        "alerts": 2,
        "lost_alerts": 0,
        "doubled_alerts": 0,
        "stuck_alerts": 0,
    }


def test_a_list_without_a_row_is_lost_and_one_with_two_is_doubled() -> None:
    published = lists("....")
    stored = {**once(published), "list-w1-1": 2, "list-w9-9": 1}
    del stored["list-w1-3"]
    found = losses(published, stored, set(), {}, pallet_before=False)
    assert (found.lost_lists, found.doubled_lists) == (1, 1)
    assert missing(published, stored) == ["list-w1-3"]


@pytest.mark.parametrize(
    ("alerts", "lost", "doubled", "stuck"),
    [("R", 0, 0, 0), ("", 1, 0, 0), ("RR", 0, 1, 0), ("O", 0, 0, 1)],
)
def test_an_arrival_that_is_over_has_one_alert_that_is_resolved(
    alerts: str, lost: int, doubled: int, stuck: int
) -> None:
    found = cost("..PP..", alerts=alerts)
    assert (found.lost_alerts, found.doubled_alerts, found.stuck_alerts) == (lost, doubled, stuck)


def test_a_pallet_that_is_still_in_view_has_an_open_alert() -> None:
    assert cost("..PP", alerts="O").stuck_alerts == 0
    assert cost("..PP", alerts="R").stuck_alerts == 1


def test_without_lists_what_was_in_view_before_is_in_view() -> None:
    found = losses([], {}, {"open"}, {"open": True}, pallet_before=True)
    assert (found.lists, found.alerts, found.stuck_alerts) == (0, 0, 0)
