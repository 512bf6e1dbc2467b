from tests.services.monitor.web.asking import Web


async def test_the_description_says_of_every_call_that_it_wants_a_token(web: Web) -> None:
    async with await web.program() as program:
        found = (await program.get("/api/openapi.json")).json()
        (scheme,) = found["components"]["securitySchemes"].items()
        assert (scheme[0], scheme[1]["type"], scheme[1]["scheme"]) == ("token", "http", "bearer")
        calls = [call for path in found["paths"].values() for call in path.values()]
        assert len(calls) > 10
        assert all(call["security"] == [{"token": []}] for call in calls)
