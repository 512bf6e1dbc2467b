import pytest

from services.access.fleet_file import FleetFileError, expand, read_fleet
from services.access.rules import access_control


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("r1", ["r1"]),
        ("r9..r11", ["r9", "r10", "r11"]),
        ("lift-08..lift-10", ["lift-08", "lift-09", "lift-10"]),
        ("a1b1..a1b2", ["a1b1", "a1b2"]),
        ("r3..r3", ["r3"]),
    ],
)
def test_a_range_stands_for_its_names(text: str, names: list[str]) -> None:
    assert list(expand(text)) == names


@pytest.mark.parametrize("text", ["r2..r1", "r1..s2", "r1..", "..r1", "r..s", "r1..r99999", "a b", "", "r*"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"range|name"):
        list(expand(text))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("robots:\n - r1\n - r5..r2\n", r"line 3: robots\.1: 'r5\.\.r2': write a range like r1\.\.r200"),
        ("robots: [r1]\nroles:\n  gpu1: driver\n", "line 3: roles.gpu1.0: Input should be 'detector', 'space'"),
        ("robots: [r1..r3, r2]\n", "r2 is there twice"),
        ("robots: [gpu1]\nroles: {gpu1: detector}\n", "gpu1 is there twice"),
        ("robots: [r1, r1-arm]\n", "r1-arm begins with another name and a dash, so r1 could speak for it"),
        ("robots: [r1]\nroles: {r1-space-2: space}\n", "r1-space-2 begins with another name and a dash"),
        ("roles: {gpu: detector, gpu-2: detector}\n", "so gpu could speak for it"),
        ("robots: [r1]\ndenied: [r2]\n", "r2 is neither a robot nor has a role"),
        ("robot: [r1]\n", "line 1: robot: Extra inputs are not permitted"),
        ("roles: {gpu1: []}\n", "roles.gpu1: Value should have at least 1 item"),
        ("roles: {'gpu 1': detector}\n", "certificate name 'gpu 1'"),
        ("robots: [r1..r15000, s1..s15000]\n", "robots: 30000 names, of at most 20000"),
        ("robots: [\n", "line 2: "),
        ("- r1\n", "line 1: "),
    ],
)
def test_a_mistake_is_told_with_its_line(text: str, reason: str) -> None:
    with pytest.raises(FleetFileError, match=reason):
        read_fleet(text)


def test_nobody_may_do_anything_where_nobody_is_named() -> None:
    rules = access_control(read_fleet(""))
    assert (rules["enabled"], rules["default_permission"], rules["rules"]) == (True, "deny", [])


def test_who_is_denied_has_no_subject() -> None:
    rules = access_control(read_fleet("robots: [r1..r3]\nroles: {wall: observer}\ndenied: [r2..r3, wall]\n"))
    assert [subject["cert_common_names"] for subject in rules["subjects"]] == [["r1"]]


def test_rules_name_each_message_kind_of_zenoh_and_allow_alone() -> None:
    rules = access_control(read_fleet("robots: [r1]\nroles: {central: [monitor, worldmodel], gpu1: detector}\n"))[
        "rules"
    ]
    assert {kind for rule in rules for kind in rule["messages"]} == {
        *("put", "delete", "reply", "query", "declare_subscriber", "declare_queryable"),
        *("liveliness_token", "declare_liveliness_subscriber", "liveliness_query"),
    }
    assert {rule["permission"] for rule in rules} == {"allow"}
    assert all(rule["key_exprs"] for rule in rules)
