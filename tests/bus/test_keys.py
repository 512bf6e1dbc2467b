import pytest

from bus import BusError
from bus.keys import key_expression, matches, single_key


def test_a_single_key_has_no_wildcard() -> None:
    assert single_key("fleet/r1/front/color") == "fleet/r1/front/color"
    assert key_expression("fleet/*/**") == "fleet/*/**"
    with pytest.raises(BusError, match="wildcard"):
        single_key("fleet/*/front/color")
    with pytest.raises(BusError, match="not a key expression"):
        key_expression("fleet//r1")
    with pytest.raises(BusError, match="not a key expression"):
        key_expression("fleet/\udc80")


@pytest.mark.parametrize(
    ("key_expr", "key", "matching"),
    [
        ("fleet/*/*/classes", "fleet/r1/front/classes", True),
        ("fleet/*/*/classes", "fleet/r1/classes", False),
        ("fleet/**", "fleet", True),
        ("**", "fleet/r1", True),
        ("**", "fleet/@adv/r1", False),
    ],
)
def test_matching_is_zenohs(key_expr: str, key: str, *, matching: bool) -> None:
    assert matches(key_expr, key) is matching
