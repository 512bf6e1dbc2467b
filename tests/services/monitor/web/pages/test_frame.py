"""The limit of open pages, and error pages."""

import httpx
from nicegui import Client
from nicegui import app as nicegui_app

from bus.fake import FakeNetwork
from services.monitor.web.auth.users import Role
from services.monitor.web.pages.frame import MOST_LEFT, MOST_OPEN, OPEN_PAGES, OpenPages
from tests.services.monitor.web.serving import monitor_on, served


class Tab:
    """A page that a browser is connected to, or not."""

    def __init__(self, *, connected: bool) -> None:
        self.has_socket_connection = connected
        self.is_deleted = False

    def delete(self) -> None:
        self.is_deleted = True


def visited(visits: OpenPages, *, connected: bool, made: bool = True, name: str = "ann") -> Tab:
    assert visits.make_room(name)
    tab = Tab(connected=connected)
    visits.begin(name, tab).made = made
    return tab


def test_of_what_was_fetched_and_left_the_newest_are_kept() -> None:
    visits = OpenPages()
    tabs = [visited(visits, connected=False) for _ in range(MOST_LEFT)]
    other = visited(visits, connected=False, name="bob")
    assert not any(tab.is_deleted for tab in tabs)
    tabs.append(visited(visits, connected=False))
    assert [tab.is_deleted for tab in tabs] == [True, *[False] * MOST_LEFT]
    assert not other.is_deleted


def test_a_page_that_is_open_or_still_being_made_is_not_given_up() -> None:
    visits = OpenPages()
    tabs = [visited(visits, connected=True), visited(visits, connected=False, made=False)]
    for _ in range(2 * MOST_LEFT):
        visited(visits, connected=False)
    assert not any(tab.is_deleted for tab in tabs)


def test_nobody_has_more_pages_open_than_may_be_and_closing_one_makes_room() -> None:
    visits = OpenPages()
    tabs = [visited(visits, connected=True) for _ in range(MOST_OPEN)]
    assert not visits.make_room("ann")
    assert visits.make_room("bob")
    tabs[7].delete()
    assert visits.make_room("ann")


async def test_pages_that_are_fetched_and_never_opened_fill_no_memory_and_too_many_are_refused() -> None:
    async with FakeNetwork().open_bus() as bus, served(monitor_on(bus)) as at:
        before = len(Client.instances)
        headers = {"Authorization": f"Bearer {at.token}"}
        async with httpx.AsyncClient(base_url=at.url, headers=headers, timeout=60) as program:
            for _ in range(MOST_LEFT + 5):
                assert (await program.get("/alerts")).status_code == 200
            assert len(Client.instances) <= before + MOST_LEFT
            tabs = [Tab(connected=True) for _ in range(MOST_OPEN)]
            for tab in tabs:
                OPEN_PAGES.begin(Role.OPERATOR, tab)
            refused = await program.get("/alerts")
            assert (refused.status_code, "Close some of them" in refused.text) == (503, True)
            for tab in tabs:
                tab.delete()
            assert (await program.get("/alerts")).status_code == 200


async def test_what_is_answered_instead_of_a_page_says_what_to_do() -> None:
    async with FakeNetwork().open_bus() as bus, served(monitor_on(bus)) as at:

        @nicegui_app.get("/broken")
        async def broken() -> None:
            raise ValueError("of the page's code")

        async with httpx.AsyncClient(headers={"Authorization": f"Bearer {at.token}"}, timeout=60) as program:
            nowhere = await program.get(f"{at.url}/<b>nowhere")
            assert (nowhere.status_code, "<b>" in nowhere.text) == (404, False)
            assert "There is no such page" in nowhere.text
            assert 'href="/"' in nowhere.text
            wrong = await program.get(f"{at.url}/broken")
            assert (wrong.status_code, "of the page" in wrong.text) == (500, False)
            assert "log says what is wrong" in wrong.text
        nicegui_app.remove_route("/broken")
