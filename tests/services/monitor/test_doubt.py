import msgspec

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.inventory.inventory import Inventory
from services.monitor.snapshot import known_until_ns
from tests.services.monitor.inventory.seeing import FRONT, S, seen

BOXES = Alert(
    id="1",
    rule="boxes",
    severity=Severity.INFO,
    state=AlertState.RAISED,
    robot="r1",
    camera="front",
    name="box",
    text="3 box in view of r1/front, over 1",
    raised_ns=101 * S,
    changed_ns=101 * S,
)


def seeing() -> Inventory:
    """Return an inventory whose one camera spoke last at 101 s."""
    inventory = Inventory()
    inventory.robot_presence("r1", alive=True)
    inventory.camera_presence(FRONT, alive=True)
    for second in (100, 101):
        inventory.see(seen(second, {"box": 3}), second * S)
    return inventory


def test_what_an_alert_says_is_known_while_its_camera_speaks() -> None:
    assert known_until_ns(BOXES, seeing(), 103 * S) is None


def test_it_is_not_known_once_the_camera_is_silent_or_the_robot_gone() -> None:
    inventory = seeing()
    assert known_until_ns(BOXES, inventory, 105 * S) == 101 * S
    inventory.robot_presence("r1", alive=False)
    assert known_until_ns(BOXES, inventory, 102 * S) == 101 * S
    inventory.robot_presence("r1", alive=True)
    assert known_until_ns(BOXES, inventory, 102 * S) is None


def test_what_was_raised_before_a_restart_was_known_then() -> None:
    earlier = msgspec.structs.replace(BOXES, raised_ns=7 * S)
    assert known_until_ns(earlier, Inventory(), 100 * S) == 7 * S
    inventory = Inventory()
    inventory.camera_presence(FRONT, alive=True)
    assert known_until_ns(earlier, inventory, 100 * S) == 7 * S


def test_silence_is_known_and_so_is_that_an_alert_is_over() -> None:
    silent = msgspec.structs.replace(BOXES, name="", text="r1/front is silent")
    assert known_until_ns(silent, seeing(), 200 * S) is None
    assert known_until_ns(msgspec.structs.replace(silent, camera=""), Inventory(), 200 * S) is None
    resolved = msgspec.structs.replace(BOXES, state=AlertState.RESOLVED)
    assert known_until_ns(resolved, Inventory(), 200 * S) is None
