from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import codec, keys, worker_keys
from schemas.distances import MAX_GRID, CameraView, DepthGrid
from schemas.errors import SchemaError
from schemas.worker_keys import WorldStream, world_key
from schemas.world import ChangeKind, FloorLooks, WorldChange, WorldChanges, WorldObject, WorldRequest
from tests.schemas.world import CHANGE, FLOOR, OBJECT, REQUEST, grid, view, viewed

names = st.from_regex(keys.NAME, fullmatch=True)


@given(names, st.sampled_from(WorldStream))
def test_keys_of_a_site_parse_back(site: str, stream: WorldStream) -> None:
    assert worker_keys.parse_world(world_key(site, stream)) == (site, stream)


def test_keys_of_a_site_are_those_of_the_contract() -> None:
    found = [world_key("hall", stream) for stream in WorldStream]
    assert found == [f"world/hall/{last}" for last in ("changes", "objects", "floor", "status", "state")]
    assert worker_keys.EVERY_WORLD_STATUS == "world/*/status"


@pytest.mark.parametrize("key", ["world/a", "world/a/b", "world/*/changes", "fleet/a/changes", "world//changes"])
def test_other_keys_are_no_sites(key: str) -> None:
    with pytest.raises(SchemaError):
        worker_keys.parse_world(key)


def sent(schema: type[Any], fields: dict[str, Any]) -> Any:
    return codec.decode(schema, msgspec.msgpack.encode(fields), codec.encoding(schema))


def test_an_object_that_merges_says_into_which() -> None:
    with pytest.raises(SchemaError, match="merged without"):
        WorldChange(kind=ChangeKind.MERGED, at_ns=1, object=OBJECT)
    with pytest.raises(SchemaError, match="gone with"):
        WorldChange(kind=ChangeKind.GONE, at_ns=1, object=OBJECT, into="a1-8")
    assert msgspec.structs.replace(CHANGE, kind=ChangeKind.MERGED, into="a1-8").into == "a1-8"


@pytest.mark.parametrize(
    "wrong",
    [
        {"existence": 1.5},
        {"at": [0, 0, float("nan")]},
        {"id": ""},
        {"size": [1, 1, -1]},
        {"yaw": 4.0},
        {"covariance": [1, 2, 3]},
        {"site": "a/b"},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_an_object_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    changes = {"site": "hall-2", "epoch": "e", "first": 1, "sent_ns": 1}
    fields = msgspec.to_builtins(OBJECT) | wrong
    change = {"kind": "appeared", "at_ns": 1, "object": fields}
    with pytest.raises(SchemaError):
        sent(WorldChanges, changes | {"changes": [change]})


def test_a_misspelt_request_is_refused() -> None:
    with pytest.raises(SchemaError, match="unknown field"):
        sent(WorldRequest, msgspec.to_builtins(REQUEST) | {"clas": "pallet"})


def test_a_grid_has_as_many_depths_as_cells() -> None:
    with pytest.raises(SchemaError, match="bytes for 8 cells"):
        msgspec.structs.replace(grid(), columns=4)
    with pytest.raises(SchemaError, match=f"at most {MAX_GRID}"):
        msgspec.structs.replace(grid(), columns=MAX_GRID, rows=2)
    with pytest.raises(SchemaError, match="bytes of ages"):
        msgspec.structs.replace(FLOOR, columns=3)


def test_a_view_is_located_or_says_why_not() -> None:
    with pytest.raises(SchemaError, match="neither known nor unknown"):
        msgspec.structs.replace(view(), position=None)
    with pytest.raises(SchemaError, match="known, and unknown"):
        msgspec.structs.replace(view(), unlocated="no map frame")
    with pytest.raises(SchemaError, match="1 objects in a frame that is unknown"):
        msgspec.structs.replace(view(viewed()), position=None, unlocated="no map frame")


@pytest.mark.parametrize(
    "wrong", [(0, 1e10, 0, 0), (0, 0, 0, 0), (0, 0, 0, 1.02), (0, 0, 0, float("nan")), (float("inf"), 0, 0, 1)], ids=str
)
def test_a_view_is_turned_by_a_rotation(wrong: tuple[float, ...]) -> None:
    fields = msgspec.msgpack.decode(codec.encode(view()))
    with pytest.raises(SchemaError, match="a rotation of length"):
        sent(CameraView, fields | {"rotation": wrong})
    sent(CameraView, fields | {"rotation": (0, 0, 0, 1.009)})


def test_a_view_of_many_objects_is_a_few_kilobytes() -> None:
    seen = msgspec.structs.replace(view(*[viewed()] * 15), grid=grid(32, 24))
    payload = codec.encode(seen)
    assert len(payload) < 9_000
    read = codec.decode(CameraView, payload, codec.encoding(CameraView))
    assert read == seen
    assert read.grid is not None
    assert read.grid.near_mm.obj is payload


def test_structures_of_the_world_are_immutable() -> None:
    for each in (OBJECT, FLOOR, grid()):
        assert isinstance(each, WorldObject | FloorLooks | DepthGrid)
        with pytest.raises(AttributeError):
            each.site = "other"  # type: ignore[union-attr, misc]
