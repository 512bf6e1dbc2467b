"""Inventory queries on the bus."""

import msgspec
import pytest

from bus import RefusedError
from bus.fake import FakeNetwork
from schemas import codec, keys
from schemas.alerts import Action
from schemas.header import MAX_LABEL
from schemas.inventory import MAX_PROBLEMS, InventoryAnswer, InventoryRequest
from services.monitor.fleet import Fleet
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import TrustLimits
from services.monitor.requests import inventory_queries
from services.monitor.requests.inventory_queries import answer_inventory, answer_to
from tests.services.monitor.inventory.seeing import S, seen


def fleet_of(counts: dict[str, int]) -> Fleet:
    fleet = Fleet("clock", TrustLimits(Debounce(1, 0, 1, 0)))
    fleet.see(seen(0, counts), 1.0, S)
    return fleet


async def test_what_went_out_of_view_is_told_unless_it_is_not_wanted() -> None:
    fleet = fleet_of({"box": 2, "pallet": 1})
    fleet.see(seen(1, {"pallet": 1}), 2.0, 2 * S)
    every = await answer_to(InventoryRequest(), fleet, (), 3 * S)
    assert [(each.name, each.count, each.last_ns) for each in every.sightings] == [("box", 0, S), ("pallet", 1, 2 * S)]
    in_view = await answer_to(InventoryRequest(robot="r1", in_view=True), fleet, (), 3 * S)
    assert [each.name for each in in_view.sightings] == ["pallet"]


async def test_an_answer_that_is_cut_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inventory_queries, "MAX_SIGHTINGS", 2)
    assert (await answer_to(InventoryRequest(), fleet_of({"a": 1, "b": 1}), (), S)).complete
    answer = await answer_to(InventoryRequest(), fleet_of({"a": 1, "b": 1, "c": 1}), (), S)
    assert ([each.name for each in answer.sightings], answer.complete) == (["a", "b"], False)


async def test_an_answer_says_how_far_it_can_be_relied_on() -> None:
    fleet = fleet_of({"box": 1})
    fleet.see(seen(0, {"box": 1}), 2.0, S)  # a double
    fleet.left_out["malformed messages"] += 2
    answer = await answer_to(InventoryRequest(in_view=True), fleet, ["history is not being kept: " + "x" * 999], S)
    assert (answer.class_lists, answer.left_out) == (1, {"malformed messages": 2})
    assert [len(problem) for problem in answer.problems] == [MAX_LABEL]
    problems = [f"webhook {number} takes no alerts" for number in range(MAX_PROBLEMS + 4)]
    answer = await answer_to(InventoryRequest(in_view=True), fleet, problems, S)
    assert codec.decode(InventoryAnswer, codec.encode(answer), codec.encoding(InventoryAnswer)) == answer
    assert answer.problems == [*problems[: MAX_PROBLEMS - 1], "and 5 more problems"]
    assert codec.decode(InventoryAnswer, codec.encode(answer), codec.encoding(InventoryAnswer)) == answer


async def test_programs_ask_over_the_bus() -> None:
    network = FakeNetwork()
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        answer_inventory(ours, fleet_of({"a": 1}), tuple),
    ):
        for asked in (b"", codec.encode(InventoryRequest(name="a"))):
            reply = await theirs.request(keys.INVENTORY, asked, encoding=codec.encoding(InventoryRequest), timeout_s=5)
            answer = codec.decode(InventoryAnswer, reply.payload, reply.encoding)
            assert [(each.robot, each.camera, each.name) for each in answer.sightings] == [("r1", "front", "a")]
        misspelt = msgspec.msgpack.encode({"class": "a"})
        with pytest.raises(RefusedError, match="unknown field `class`"):
            await theirs.request(keys.INVENTORY, misspelt, encoding=codec.encoding(InventoryRequest), timeout_s=5)
        with pytest.raises(RefusedError, match="InventoryRequest"):
            await theirs.request(keys.INVENTORY, b"?", encoding=codec.encoding(Action), timeout_s=5)
