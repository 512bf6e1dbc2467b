from schemas.keys import CameraKey
from schemas.status import CameraLoad
from services.cloud.account import REPLACED, UNJOINED, Account


def test_what_never_happened_is_not_listed() -> None:
    account = Account(CameraKey("r1", "front"))
    account.done = 3
    account.dropped[UNJOINED] += 2
    account.dropped[REPLACED] += 0
    assert account.load(serving=True) == CameraLoad(
        robot="r1", camera="front", inferred=3, dropped={UNJOINED: 2}, serving=True
    )
