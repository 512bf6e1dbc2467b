"""Lost and doubled class lists and alerts are told from those that are neither."""

import pytest

from benchmarks.chaos.accounts import Alerts, Losses, Published, Window, arrivals, losses, missing


def lists(views: str) -> list[Published]:
    """Return a list for each letter: P with a pallet in view, any other one without."""
    return [Published(f"list-w1-{number}", number, pallet=view == "P") for number, view in enumerate(views)]


def once(published: list[Published]) -> dict[str, int]:
    return {each.mark: 1 for each in published}


NOWHEN = Window(0, 0, before=False)


def cost(views: str, *, alerts: str = "", told: set[str] | None = None, window: Window = NOWHEN) -> Losses:
    """Return what is lost of lists that are all at the store. alerts: a letter for each new one, O while open."""
    published = lists(views)
    after = {"old": False, **{f"new{number}": state == "O" for number, state in enumerate(alerts)}}
    return losses(published, once(published), Alerts({"old"}, after, told or set()), window)


def test_a_line_of_a_journal_is_read_as_it_was_written() -> None:
    for published in lists(".P"):
        assert Published.read(published.line()) == published


def test_a_line_that_a_killed_worker_did_not_finish_is_none() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        Published.read("list-w1-1 17")


@pytest.mark.parametrize(
    ("views", "before", "expected"),
    [("", False, []), ("..PP..P", False, [2, 6]), ("PP..", False, [0]), ("PP..", True, []), ("PP..P", True, [4])],
)
def test_a_pallet_arrives_where_there_was_none(views: str, before: bool, expected: list[int]) -> None:  # noqa: FBT001
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
        "passed_alerts": 0,
        "doubled_alerts": 0,
        "unstored_alerts": 0,
        "stuck_alerts": 0,
    }


def test_a_list_without_a_row_is_lost_and_one_with_two_is_doubled() -> None:
    published = lists("....")
    stored = {**once(published), "list-w1-1": 2, "list-w9-9": 1}
    del stored["list-w1-3"]
    found = losses(published, stored, Alerts(set(), {}), NOWHEN)
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
    found = losses([], {}, Alerts({"open"}, {"open": True}), Window(0, 0, before=True))
    assert (found.lists, found.alerts, found.stuck_alerts) == (0, 0, 0)


@pytest.mark.parametrize(("began", "well", "expected"), [(0, 9, 1), (3, 9, 0), (0, 3, 0), (2, 4, 1)])
def test_an_alert_whose_pallet_came_and_went_during_the_fault_is_lost_as_one_that_passed(
    began: int, well: int, expected: int
) -> None:
    found = cost("..PP..", window=Window(began, well, before=False))
    assert (found.lost_alerts, found.passed_alerts) == (1, expected)


def test_alerts_that_subscribers_were_told_of_count_too() -> None:
    told_twice = cost("..PP..", alerts="R", told={"new0", "forgotten"})
    assert (told_twice.doubled_alerts, told_twice.unstored_alerts, told_twice.figures()["lost"]) == (1, 1, 1)
