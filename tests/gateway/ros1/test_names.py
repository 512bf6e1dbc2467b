from __future__ import annotations

import pytest

from gateway.ros1.errors import InvalidNameError
from gateway.ros1.names import (
    MAX_NAME_CHARACTERS,
    Names,
    namespace_of,
    resolve,
    validate,
    validate_global,
    validate_type,
)


@pytest.mark.parametrize("name", ["/a", "a", "~a", "/a/b_1", "/1/2d", "A/b", "/_hidden", "~1"])
def test_legal_names(name: str) -> None:
    assert validate(name) == name


@pytest.mark.parametrize("name", ["", "/", "~", "1a", "a b", "a-b", "/a/", "/a//b", "/ä", "a/~b", "/a\n"])
def test_illegal_names(name: str) -> None:
    with pytest.raises(InvalidNameError):
        validate(name)


def test_longest_name_and_one_character_more() -> None:
    validate("a" * MAX_NAME_CHARACTERS)
    with pytest.raises(InvalidNameError):
        validate("a" * (MAX_NAME_CHARACTERS + 1))


@pytest.mark.parametrize("name", ["a", "~a", "", "//"])
def test_names_that_are_not_global(name: str) -> None:
    with pytest.raises(InvalidNameError):
        validate_global(name)


@pytest.mark.parametrize("name", ["Image", "sensor_msgs/msg/Image", "sensor_msgs/", "/Image", "1/a", "*", ""])
def test_illegal_types(name: str) -> None:
    with pytest.raises(InvalidNameError):
        validate_type(name)


@pytest.mark.parametrize(
    ("name", "resolved"),
    [
        ("/a", "/a"),
        ("a", "/ns/a"),
        ("a/b", "/ns/a/b"),
        ("~a", "/ns/node/a"),
        ("//a//b/", "/a/b"),
    ],
)
def test_resolving_within_a_node(name: str, resolved: str) -> None:
    assert resolve(name, "/ns/node") == resolved


def test_relative_name_of_a_node_without_namespace() -> None:
    assert resolve("a", "/node") == "/a"


@pytest.mark.parametrize(("name", "node"), [("", "/n"), ("/", "/n"), ("a", "n"), ("a b", "/n")])
def test_unresolvable(name: str, node: str) -> None:
    with pytest.raises(InvalidNameError):
        resolve(name, node)


def test_namespace() -> None:
    assert namespace_of("/a") == "/"
    assert namespace_of("/a/b/c") == "/a/b/"


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("/scan", "/base_scan"),
        ("image", "/r1/front/image"),
        ("/r1/image", "/r1/front/image"),
        ("/image", "/image"),
        ("/scan/more", "/scan/more"),
        ("/a", "/b"),
        ("/b", "/a"),
        ("~debug", "/r1/elsewhere"),
        ("other", "/r1/other"),
    ],
)
def test_names_are_remapped_once_and_whole(name: str, meant: str) -> None:
    remaps = {"/scan": "/base_scan", "image": "front//image/", "/a": "/b", "/b": "/a", "~debug": "elsewhere"}
    assert Names("/r1/gateway", remaps).resolve(name) == meant


@pytest.mark.parametrize("remaps", [{"a b": "/c"}, {"/c": ""}])
def test_remapping_of_what_is_no_name(remaps: dict[str, str]) -> None:
    with pytest.raises(InvalidNameError):
        Names("/gateway", remaps)
