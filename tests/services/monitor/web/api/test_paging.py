"""Parameters of the API, and its description."""

from tests.services.monitor.web.asking import Web


async def test_a_parameter_that_a_route_does_not_have_is_refused_and_named(web: Web) -> None:
    async with await web.program() as program:
        for query, reason in (
            ("cameras?robt=r1", "unknown parameter 'robt': known are after, limit, online, robot"),
            ("robots?limit=2&robot=r1", "unknown parameter 'robot': known are after, limit, online"),
            ("status?robot=r1", "unknown parameter 'robot': none is known here"),
            ("cameras?robot=r1&robot=r2", "'robot' is given more than once"),
            ("history/alerts?state=raised&since=2026-11-20T06:00Z&state=raised", "'state' is given more than once"),
        ):
            answer = await program.get(f"/api/v1/{query}")
            assert (answer.status_code, answer.json()) == (422, {"error": reason})
        shared = await program.get("/api/v1/history/alerts?class=box&state=raised&since=2026-11-20T06:00Z")
        assert shared.status_code == 503, "there is no history here, and nothing wrong with the question"
        for query in ("history/sightings?name=box", "history/export?since_ns=1"):
            assert (await program.get(f"/api/v1/{query}")).status_code == 422


async def test_a_time_may_be_seconds_since_the_epoch_and_a_zone_other_than_utc(web: Web) -> None:
    async with await web.program() as program:
        for since in ("1763618400", "1763618400.5", "2026-11-20T06:00Z", "2026-11-20T07:00%2B01:00"):
            answer = await program.get(f"/api/v1/history/sightings?since={since}")
            assert answer.status_code == 503, "there is no history here, and nothing wrong with the question"
        for since in ("2026-11-20T06:00", "2026-11-20T07:00+01:00"):  # a space, as a URL goes
            answer = await program.get(f"/api/v1/history/sightings?since={since}")
            assert answer.json() == {"error": "since: write a time like 2026-11-20T06:00Z"}


async def test_a_refused_act_on_an_alert_is_not_done(web: Web) -> None:
    async with await web.program() as program:
        answer = await program.post("/api/v1/alerts/a1/resolve?robot=r1")
        assert (answer.status_code, answer.json()["error"]) == (
            422,
            "unknown parameter 'robot': none is known here",
        )


async def test_the_description_says_of_every_call_that_it_wants_a_token(web: Web) -> None:
    async with await web.program() as program:
        found = (await program.get("/api/openapi.json")).json()
        (scheme,) = found["components"]["securitySchemes"].items()
        assert (scheme[0], scheme[1]["type"], scheme[1]["scheme"]) == ("token", "http", "bearer")
        calls = [call for path in found["paths"].values() for call in path.values()]
        assert len(calls) > 10
        assert all(call["security"] == [{"token": []}] for call in calls)
