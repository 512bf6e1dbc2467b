from typing import Any

import msgspec
import pytest

from schemas import codec
from schemas.detections import MAX_DETECTIONS
from schemas.distances import MAX_PLACES, Distances, ObjectDistance, Place
from schemas.errors import SchemaError
from schemas.space import MAX_COORDINATE_M, MAX_DISTANCE_M
from tests.schemas.results import distances, known, unknown

GOOD = known("box", 2.3125)


def sent(**measured: Any) -> Distances:
    """Send one distance with other numbers over the wire."""
    fields = msgspec.to_builtins(distances(GOOD))
    fields["objects"][0]["measured"] |= measured
    return codec.decode(Distances, msgspec.msgpack.encode(fields), codec.encoding(Distances))


def test_a_distance_is_known_or_unknown_for_a_reason() -> None:
    with pytest.raises(SchemaError, match="distance of box is neither known nor unknown"):
        ObjectDistance(name="box", index=0, valid_share=0)
    with pytest.raises(SchemaError, match="distance of box is known, and unknown"):
        msgspec.structs.replace(GOOD, unknown="no depth")
    with pytest.raises(SchemaError, match="place in map is neither"):
        Place(frame_id="map")
    with pytest.raises(SchemaError, match="place in map is known, and unknown"):
        Place(frame_id="map", at=(0, 0, 1), unknown="no transform")


@pytest.mark.parametrize("number", [0.0, -1.0, float("inf"), float("nan"), MAX_DISTANCE_M * 1.01])
@pytest.mark.parametrize("field", ["axial_m", "euclidean_m", "mean_m", "nearest_m"])
def test_no_reading_cannot_pass_for_a_distance(field: str, number: float) -> None:
    with pytest.raises(SchemaError, match=field):
        sent(**{field: number})


def test_distances_up_to_the_bounds_are_carried() -> None:
    assert sent(axial_m=MAX_DISTANCE_M, nearest_m=5e-324, spread_m=0.0).objects[0].measured is not None
    with pytest.raises(SchemaError, match="spread_m"):
        sent(spread_m=-0.1)


@pytest.mark.parametrize("number", [float("inf"), float("nan"), MAX_COORDINATE_M * 1.01])
def test_places_are_finite(number: float) -> None:
    (found,) = sent(places=[{"frame_id": "map", "at": [0, 0, -MAX_COORDINATE_M]}]).objects
    assert found.measured is not None
    assert found.measured.places[0].at == (0, 0, -MAX_COORDINATE_M)
    with pytest.raises(SchemaError, match="places"):
        sent(places=[{"frame_id": "map", "at": [0, number, 0]}])


def test_lists_are_bounded() -> None:
    place = {"frame_id": "map", "unknown": "no transform"}
    (found,) = sent(places=[place] * MAX_PLACES).objects
    assert found.measured is not None
    assert len(found.measured.places) == MAX_PLACES
    with pytest.raises(SchemaError, match="places"):
        sent(places=[place] * (MAX_PLACES + 1))
    many = codec.encode(distances(*[unknown("box")] * (MAX_DETECTIONS + 1)))
    with pytest.raises(SchemaError, match="objects"):
        codec.decode(Distances, many, codec.encoding(Distances))


def test_the_most_that_can_be_said_is_read() -> None:
    places = [Place(frame_id="𝄞" * 256, unknown="𝄞" * 256)] * MAX_PLACES
    assert GOOD.measured is not None
    largest = msgspec.structs.replace(
        GOOD, name="𝄞" * 256, measured=msgspec.structs.replace(GOOD.measured, places=places)
    )
    payload = codec.encode(distances(*[largest] * MAX_DETECTIONS))
    assert len(codec.decode(Distances, payload, codec.encoding(Distances)).objects) == MAX_DETECTIONS
