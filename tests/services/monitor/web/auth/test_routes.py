from pathlib import Path

from services.monitor.web.application import make_application
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.passwords import MAX_OF_NAME
from services.monitor.web.auth.store import UserStore
from tests.services.monitor.web.asking import ORIGIN, Web
from tests.services.monitor.web.serving import PASSWORD


async def test_log_in_and_out_as_a_browser_does_it(web: Web) -> None:
    async with web.stranger(Origin=ORIGIN) as browser:
        form = await browser.get("/login?next=/alerts")
        assert '<input type="hidden" name="next" value="/alerts">' in form.text
        wrong = await browser.post("/login", data={"name": "<b>", "password": "x", "next": '"><script>'})
        assert (wrong.status_code, "<script>" in wrong.text, "wrong name or password" in wrong.text) == (
            403,
            False,
            True,
        )
        given = {"name": "viewer", "password": PASSWORD, "next": "/alerts"}
        right = await browser.post("/login", data=given)
        assert (right.status_code, right.headers["Location"]) == (303, "/alerts")
        cookie = right.headers["Set-Cookie"]
        assert {"HttpOnly", "SameSite=lax", "Path=/"} <= set(cookie.split("; "))
        assert "Secure" not in cookie
        assert (await browser.get("/api/v1/me")).json() == {"name": "viewer", "role": "viewer"}
        out = await browser.post("/logout")
        assert (out.status_code, out.headers["Location"], len(browser.cookies)) == (303, "/login", 0)
        browser.cookies.set("fleetsight-0", cookie.split(";")[0].split("=")[1])
        assert (await browser.get("/api/v1/me")).status_code == 401


async def test_who_tries_too_often_is_told_when_to_come_back(web: Web) -> None:
    async with web.stranger(Origin=ORIGIN) as browser:
        for _ in range(MAX_OF_NAME):
            await browser.post("/login", data={"name": "viewer", "password": "x"})
        refused = await browser.post("/login", data={"name": "viewer", "password": PASSWORD})
        assert (refused.status_code, 0 < int(refused.headers["Retry-After"]) <= 901) == (429, True)


async def test_odd_bodies_are_wrong_passwords(web: Web) -> None:
    async with web.stranger(Origin=ORIGIN) as browser:
        for body in (b"", b"\xff\xfe", b"name", b"a=1&" * 100, b"name=%ff&password=%00", b"password=" + b"x" * 60_000):
            assert (await browser.post("/login", content=body)).status_code == 403


async def test_the_first_user_is_made_with_the_link(web: Web, tmp_path: Path) -> None:
    access = Access(UserStore(f"sqlite:///{tmp_path / 'none.db'}"), 1, ORIGIN)
    await access.look()
    empty = Web(web.monitor, access, make_application(web.monitor, access), tmp_path)
    link = access.invitation
    async with empty.stranger(Origin=ORIGIN) as browser:
        assert (await browser.get("/")).headers["Location"] == "/setup"
        assert (await browser.get("/login")).headers["Location"] == "/setup"
        without = await browser.get("/setup")
        assert (link.split("=")[1] in without.text, "terminal" in without.text) == (False, True)
        assert link.split("=")[1] in (await browser.get(link)).text
        assert '"><b>' not in (await browser.get("/setup", params={"token": '"><b>'})).text
        given = {"token": link.split("=")[1], "name": "ann", "password": PASSWORD, "again": "x"}
        assert "not the same" in (await browser.post("/setup", data=given)).text
        assert (
            "invalid set-up link"
            in (await browser.post("/setup", data={**given, "again": PASSWORD, "token": "x"})).text
        )
        made = await browser.post("/setup", data={**given, "again": PASSWORD})
        assert (made.status_code, made.headers["Location"]) == (303, "/")
        assert (await browser.get("/api/v1/me")).json() == {"name": "ann", "role": "operator"}
        assert (await browser.get(link)).headers["Location"] == "/login"
