from bus.sharing.naming import default_worker_name
from schemas.keys import NAME


def test_a_workers_own_name_can_be_a_key() -> None:
    assert NAME.fullmatch(default_worker_name())
