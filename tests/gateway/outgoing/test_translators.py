import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.outgoing.translators import STRING, classes
from gateway.ros1.messages import deserialise
from schemas.detections import MAX_DETECTIONS
from schemas.errors import SchemaError
from tests.gateway.outgoing.lists import class_list


def text(message: bytes) -> str:
    data: str = deserialise(STRING, message).data
    return data


def test_one_entry_per_object_as_the_guide_writes_it() -> None:
    assert text(classes(class_list(("box", 2), ("pallet", 1)))) == "['box', 'box', 'pallet']"


def test_nothing_in_view_is_an_empty_list() -> None:
    assert text(classes(class_list())) == "[]"
    assert text(classes(class_list(("box", 0)))) == "[]"


@pytest.mark.parametrize("name", ["it's", 'a "box"', "both ' and \"", "back\\slash", "two\nlines", "\0", "Größe", "箱"])
def test_names_of_any_kind_stay_parseable(name: str) -> None:
    assert ast.literal_eval(text(classes(class_list((name, 2))))) == [name, name]


@given(st.lists(st.tuples(st.text(max_size=20), st.integers(0, 5)), max_size=10))
def test_every_list_is_parseable(counts: list[tuple[str, int]]) -> None:
    expected = [name for name, count in counts for _ in range(count)]
    assert ast.literal_eval(text(classes(class_list(*counts)))) == expected


def test_as_many_objects_as_an_image_can_have() -> None:
    assert len(ast.literal_eval(text(classes(class_list(("box", MAX_DETECTIONS)))))) == MAX_DETECTIONS


@pytest.mark.parametrize("counts", [[("box", MAX_DETECTIONS + 1)], [("box", MAX_DETECTIONS), ("a", 1)], [("b", 2**63)]])
def test_more_objects_are_refused_before_memory_is_taken(counts: list[tuple[str, int]]) -> None:
    with pytest.raises(SchemaError, match="objects in one image"):
        classes(class_list(*counts))
