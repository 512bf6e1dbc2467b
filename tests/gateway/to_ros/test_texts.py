import ast
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.messages import deserialise
from gateway.to_ros.outputs import STRING, action, alert, classes, distances
from schemas.alerts import MAX_PAYLOAD, AlertState
from schemas.detections import MAX_DETECTIONS, ClassList
from schemas.distances import Distances
from schemas.errors import SchemaError
from schemas.space import MAX_DISTANCE_M
from tests.gateway.to_ros.lists import class_list
from tests.schemas import results
from tests.schemas.results import known, unknown

AWKWARD = ["it's", 'a "box"', "both ' and \"", "back\\slash", "two\nlines", "\0", "Größe", "箱"]


def text(message: bytes) -> str:
    data: str = deserialise(STRING, message).data
    return data


def classes_of(seen: ClassList) -> str:
    return text(classes(seen, 1))


def distances_of(seen: Distances) -> str:
    return text(distances(seen, 1))


def test_one_entry_per_object_as_the_guide_writes_it() -> None:
    assert classes_of(class_list(("box", 2), ("pallet", 1))) == "['box', 'box', 'pallet']"


def test_nothing_in_view_is_an_empty_list() -> None:
    assert classes_of(class_list()) == classes_of(class_list(("box", 0))) == "[]"
    assert distances_of(results.distances()) == "[]"


@pytest.mark.parametrize("name", AWKWARD)
def test_names_of_any_kind_stay_parseable(name: str) -> None:
    assert ast.literal_eval(classes_of(class_list((name, 2)))) == [name, name]
    assert ast.literal_eval(distances_of(results.distances(known(name, 2.5)))) == [f"{name}: 2.50m"]


@given(st.lists(st.tuples(st.text(max_size=20), st.integers(0, 5)), max_size=10))
def test_every_list_is_parseable(counts: list[tuple[str, int]]) -> None:
    expected = [name for name, count in counts for _ in range(count)]
    assert ast.literal_eval(classes_of(class_list(*counts))) == expected


def test_as_many_objects_as_an_image_can_have() -> None:
    assert len(ast.literal_eval(classes_of(class_list(("box", MAX_DETECTIONS))))) == MAX_DETECTIONS


@pytest.mark.parametrize("counts", [[("box", MAX_DETECTIONS + 1)], [("box", MAX_DETECTIONS), ("a", 1)], [("b", 2**63)]])
def test_more_objects_are_refused_before_memory_is_taken(counts: list[tuple[str, int]]) -> None:
    with pytest.raises(SchemaError, match="objects in one image"):
        classes(class_list(*counts), 1)


def test_distances_are_along_the_optical_axis_and_unknown_ones_are_left_out() -> None:
    seen = results.distances(known("box", 2.3125), unknown("forklift", 1), known("pallet", 4.0156, 2))
    assert distances_of(seen) == "['box: 2.31m', 'pallet: 4.02m']"


def test_all_unknown_is_an_empty_list() -> None:
    assert distances_of(results.distances(unknown("box"))) == "[]"


@pytest.mark.parametrize(("axial_m", "said"), [(0.004, "0.00m"), (0.006, "0.01m"), (MAX_DISTANCE_M, "1000000.00m")])
def test_distances_have_two_digits(axial_m: float, said: str) -> None:
    assert distances_of(results.distances(known("box", axial_m))) == f"['box: {said}']"


@pytest.mark.parametrize("words", AWKWARD)
def test_an_alert_is_a_json_object_of_its_fields(words: str) -> None:
    said = json.loads(text(alert(results.alert(state=AlertState.ESCALATED, text=words), 1)))
    assert said == {
        "id": "a1",
        "rule": "too near",
        "severity": "warning",
        "state": "escalated",
        "robot": "r1",
        "camera": "front",
        "name": "forklift",
        "site": "",
        "object": "",
        "link": "",
        "text": words,
        "raised_ns": 5,
        "changed_ns": 5,
    }


@pytest.mark.parametrize("payload", ["", *AWKWARD, "a" * MAX_PAYLOAD])
def test_an_action_is_its_payload(payload: str) -> None:
    assert text(action(results.action(payload=payload), 1)) == payload
