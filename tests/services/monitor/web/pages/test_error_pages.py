import httpx
from nicegui import app as nicegui_app

from bus.fake import FakeNetwork
from tests.services.monitor.web.serving import monitor_on, served


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
