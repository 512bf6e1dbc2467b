from services.toolbox.errors import meant


def test_the_nearest_name_is_what_was_meant() -> None:
    assert meant("montor", ["detector", "monitor"]) == "; did you mean monitor?"
    assert meant("nix", ["detector", "monitor"]) == ""


def test_what_all_names_begin_with_makes_none_of_them_near() -> None:
    assert meant("OUR_OWN_CONECT", ["STREAMS", "CONNECT"], "OUR_OWN_") == "; did you mean OUR_OWN_CONNECT?"
    assert meant("OUR_OWN_SCREENS", ["STREAMS", "CONNECT"], "OUR_OWN_") == ""
