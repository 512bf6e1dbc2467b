import pytest

from bus.session.link_use import MAX_LINKS, MOST_FILES, OTHER_FILES, LinkUse, LinkWarning, most_links


@pytest.mark.parametrize("count", [0, 1, 899])
def test_while_there_is_room_there_is_nothing_to_say(count: int) -> None:
    assert LinkUse(count, 1_000).problem == ""


def test_before_all_are_taken_it_says_what_helps() -> None:
    assert LinkUse(60_000, MAX_LINKS).problem == (
        "60,000 of at most 65,280 links are in use, further ones are refused: "
        "have some robots and workers connect through another router"
    )
    assert LinkUse(1_000, 1_000).problem == (
        "1,000 of at most 1,000 links are in use, further ones are refused: "
        "let it open more files (LimitNOFILE in its unit, ulimit -n), or "
        "have some robots and workers connect through another router"
    )


def test_it_warns_once_until_some_links_have_gone() -> None:
    warning = LinkWarning()
    said = [bool(warning.news(LinkUse(count, 1_000))) for count in (1, 900, 901, 850, 900, 799, 899, 900)]
    assert said == [False, True, False, False, False, False, False, True]


@pytest.mark.parametrize(
    ("files", "links"),
    [
        (1_024, 1_024 - OTHER_FILES),
        (MOST_FILES, MAX_LINKS),
        (10**6, MAX_LINKS),
        (16_384, 16_384 - OTHER_FILES),
        (OTHER_FILES, 1),
    ],
)
def test_links_leave_files_for_everything_else(files: int, links: int) -> None:
    assert most_links(files) == links
