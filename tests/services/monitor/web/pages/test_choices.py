from services.monitor.web.pages.live_table import address


def test_an_address_has_what_was_chosen_and_nothing_else() -> None:
    assert address({"search": "r 1&x=<b>", "state": ""}) == "?search=r+1%26x%3D%3Cb%3E"
    assert address({"search": ""}) == "?"
