import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.keys import matches
from schemas import keys, worker_keys
from schemas.errors import SchemaError
from schemas.keys import CameraKey
from schemas.worker_keys import Serves, WorkerAlive

names = st.from_regex(keys.NAME, fullmatch=True)


@given(names)
def test_worker_keys_parse_back(name: str) -> None:
    assert worker_keys.parse_worker(worker_keys.worker_status("detector", name)) == ("detector", name)
    assert worker_keys.parse_worker(str(WorkerAlive("detector", name))) == ("detector", name)


@given(names, names, st.floats(worker_keys.MIN_WEIGHT, worker_keys.MAX_WEIGHT), st.none() | names)
def test_a_workers_presence_says_its_weight_and_its_robot(
    service: str, worker: str, weight: float, robot: str | None
) -> None:
    parsed = worker_keys.parse_worker_alive(str(WorkerAlive(service, worker, weight, robot)))
    assert parsed == WorkerAlive(service, worker, parsed.weight, robot)
    assert parsed.weight == pytest.approx(weight, rel=1e-5)
    assert worker_keys.parse_worker_alive(str(parsed)) == parsed
    assert matches(str(parsed), worker_keys.every_worker_alive(service))


@given(names, names, names, names.filter(lambda name: name not in keys.RESERVED))
def test_what_workers_have_taken_over_parses_back(service: str, worker: str, robot: str, camera: str) -> None:
    token = Serves(service, worker, CameraKey(robot, camera))
    assert worker_keys.parse_serves(str(token)) == token
    assert matches(str(token), worker_keys.every_serves(service))


@pytest.mark.parametrize(
    "key",
    [
        "workers/detector/w1/1/alive",
        "workers/detector/w1/0/-/alive",
        "workers/detector/w1/1001/-/alive",
        "workers/detector/w1/1e3/-/alive",
        "workers/detector/w1/nan/-/alive",
        "workers/detector/w1/serves/r1/status",
        "fleet/r1/front/color/budget",
    ],
)
def test_other_keys_are_no_workers_tokens(key: str) -> None:
    for parse in (worker_keys.parse_worker_alive, worker_keys.parse_serves):
        with pytest.raises(SchemaError):
            parse(key)


@given(st.text(max_size=80))
def test_whatever_the_key_parsing_raises_schema_errors_only(key: str) -> None:
    for parse in (worker_keys.parse_worker, worker_keys.parse_worker_alive, worker_keys.parse_serves):
        try:
            parse(key)
        except SchemaError:
            continue


def test_what_a_worker_is_asked_under() -> None:
    assert worker_keys.infer("w1") == "services/detector/infer/w1"
    assert worker_keys.worker_settings("detector", "w1") == "workers/detector/w1/settings"
    assert worker_keys.every_worker_alive("detector") == "workers/detector/*/*/*/alive"
    with pytest.raises(SchemaError, match="worker name"):
        worker_keys.infer("a/b")
    with pytest.raises(SchemaError, match="worker name"):
        worker_keys.worker_settings("detector", "a/b")


@given(names, names)
def test_keys_of_a_warehouse_parse_back(warehouse: str, site: str) -> None:
    assert worker_keys.parse_warehouse_report(worker_keys.warehouse_report(warehouse)) == warehouse
    assert worker_keys.parse_warehouse_objects(worker_keys.warehouse_objects(warehouse, site)) == (warehouse, site)
    assert worker_keys.every_warehouse_objects("berlin") == "warehouses/berlin/world/*/objects"


@pytest.mark.parametrize(
    "key", ["warehouses/berlin", "warehouses/*/report", "warehouses/a/world/*/objects", "warehouses/a/objects", ""]
)
def test_other_keys_are_no_warehouses(key: str) -> None:
    for parse in (worker_keys.parse_warehouse_report, worker_keys.parse_warehouse_objects):
        with pytest.raises(SchemaError):
            parse(key)
