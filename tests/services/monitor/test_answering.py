import pytest

from bus import RefusedError
from bus.fake import FakeNetwork
from schemas import codec, keys
from schemas.alerts import Action
from schemas.inventory import InventoryAnswer, InventoryRequest
from services.monitor import answering
from services.monitor.answering import answer_inventory, answer_to
from services.monitor.inventory.inventory import Inventory, Limits
from services.monitor.inventory.settling import Debounce
from tests.services.monitor.inventory.seeing import S, seen


def inventory_of(counts: dict[str, int]) -> Inventory:
    inventory = Inventory(Limits(Debounce(1, 0, 1, 0)))
    inventory.see(seen(0, counts), S)
    return inventory


def test_what_went_out_of_view_is_told_unless_it_is_not_wanted() -> None:
    inventory = inventory_of({"box": 2, "pallet": 1})
    inventory.see(seen(1, {"pallet": 1}), 2 * S)
    every = answer_to(InventoryRequest(in_view=False), inventory, 3 * S)
    assert [(each.name, each.count, each.last_ns) for each in every.sightings] == [("box", 0, S), ("pallet", 1, 2 * S)]
    in_view = answer_to(InventoryRequest(robot="r1", in_view=True), inventory, 3 * S)
    assert [each.name for each in in_view.sightings] == ["pallet"]


def test_an_answer_that_is_cut_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answering, "MAX_SIGHTINGS", 2)
    assert answer_to(InventoryRequest(in_view=False), inventory_of({"a": 1, "b": 1}), S).complete
    answer = answer_to(InventoryRequest(in_view=False), inventory_of({"a": 1, "b": 1, "c": 1}), S)
    assert ([each.name for each in answer.sightings], answer.complete) == (["a", "b"], False)


async def test_programs_ask_over_the_bus() -> None:
    network = FakeNetwork()
    async with network.open_bus() as ours, network.open_bus() as theirs, answer_inventory(ours, inventory_of({"a": 1})):
        for asked in (b"", codec.encode(InventoryRequest(name="a", in_view=False))):
            reply = await theirs.request(keys.INVENTORY, asked, encoding=codec.encoding(InventoryRequest), timeout_s=5)
            answer = codec.decode(InventoryAnswer, reply.payload, reply.encoding)
            assert [(each.robot, each.camera, each.name) for each in answer.sightings] == [("r1", "front", "a")]
        with pytest.raises(RefusedError, match="InventoryRequest"):
            await theirs.request(keys.INVENTORY, b"?", encoding=codec.encoding(Action), timeout_s=5)
