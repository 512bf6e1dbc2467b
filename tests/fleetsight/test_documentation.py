"""All that is public is documented, and its examples do what they say, against a small fleet."""

import asyncio
import doctest
import inspect
from collections.abc import Iterator

import numpy as np
import pytest

import fleetsight
from fleetsight import api
from schemas import objects
from tests.fleetsight.stand_in import in_a_thread


def is_ours(each: object) -> bool:
    return (getattr(each, "__module__", None) or "").startswith(("fleetsight.", "schemas."))


OURS = [each for name in api.__all__ if is_ours(each := getattr(api, name))]


def documented() -> Iterator[tuple[str, object]]:
    """Yield what is ours of what is public: functions, classes and their methods, errors apart."""
    for each in OURS:
        if not (inspect.isclass(each) and issubclass(each, Exception)):
            yield each.__name__, each
        if inspect.isclass(each):
            methods = {name: getattr(each, name) for name in dir(each) if not name.startswith("_")}
            yield from ((f"{each.__name__}.{name}", own) for name, own in methods.items() if is_ours(own))


PUBLIC = {name: each for name, each in documented() if "Error" not in name}
WITHOUT_EXAMPLE = {"Results.until_wanted", "Results.until_unwanted", "CameraKey.stream", "CameraKey.alive"}


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with in_a_thread() as endpoint:
        yield endpoint


def test_what_is_public_is_found() -> None:
    assert {"connect", "Fleet", "Fleet.class_lists", "Fleet.detect", "Roster.present", "Stream"} <= PUBLIC.keys()
    assert set(api.__all__) <= set(dir(fleetsight))


@pytest.mark.parametrize("name", PUBLIC)
def test_it_says_what_it_does_with_an_example(name: str) -> None:
    text = inspect.getdoc(PUBLIC[name])
    assert text
    assert (">>> " in text) is (name not in WITHOUT_EXAMPLE)


EXAMPLES = {
    found.name: found
    for each in OURS
    for found in doctest.DocTestFinder(exclude_empty=True).find(each, each.__name__)
    if found.examples
} | {found.name: found for found in doctest.DocTestFinder().find(api.Fleet.__mro__[1], "Listening") if found.examples}


@pytest.mark.parametrize("name", EXAMPLES)
def test_its_example_does_what_it_says(name: str, endpoint: str) -> None:
    example = EXAMPLES[name]
    example.globs = {**vars(objects), "fleetsight": fleetsight, "asyncio": asyncio, "np": np, "endpoint": endpoint}
    example.globs["header"] = fleetsight.Header(
        robot="r1", camera="front", boot_id="b1", seq=7, stamp_ns=0, frame_id="camera", received_ns=0
    )
    said: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append)
    assert not said, "".join(said)


def test_an_error_says_what_it_means() -> None:
    errors = [each for each in OURS if inspect.isclass(each) and issubclass(each, Exception)]
    assert len(errors) == 12
    assert all(issubclass(each, fleetsight.FleetsightError) and each.__doc__ for each in errors)


def test_a_star_import_gives_all_that_is_public() -> None:
    names: dict[str, object] = {}
    exec("from fleetsight import *", names)  # noqa: S102 - it is allowed at the top of a module alone
    assert {name: names[name] for name in api.__all__} == {name: getattr(api, name) for name in api.__all__}


def test_what_there_is_not_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="module 'fleetsight' has no attribute 'conect'"):
        _ = fleetsight.conect  # type: ignore[attr-defined]
