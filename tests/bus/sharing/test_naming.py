from bus.sharing.naming import default_worker_name
from schemas.keys import NAME


def test_a_workers_own_name_can_be_a_key() -> None:
    assert NAME.fullmatch(default_worker_name())


def test_two_containers_on_one_host_have_the_same_machine_and_process() -> None:
    assert default_worker_name() != default_worker_name()
