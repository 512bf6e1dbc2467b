import pytest
from pydantic import ValidationError

from bus.sharing import SharingSettings
from schemas.worker_keys import WorkerAlive


def test_a_worker_is_for_any_robot_and_weighs_one_unless_told() -> None:
    assert SharingSettings(worker="w1").tokens("detector") == [WorkerAlive("detector", "w1", 1.0, None)]


def test_a_worker_has_a_token_for_each_of_its_robots() -> None:
    tokens = SharingSettings(worker="w1", weight=2.5, robots=["r1", "r2"]).tokens("detector")
    assert [str(token) for token in tokens] == [f"workers/detector/w1/2.5/{robot}/alive" for robot in ("r1", "r2")]


def test_a_worker_weighs_what_others_read() -> None:
    assert SharingSettings(weight=1 / 3).tokens("detector")[0].weight == 0.333333


@pytest.mark.parametrize(
    ("field", "value"), [("weight", 0), ("weight", 1001), ("weight", float("nan")), ("robots", ["a/b"])]
)
def test_what_is_out_of_range_is_named(field: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        SharingSettings.model_validate({field: value})
    assert caught.value.errors()[0]["loc"][0] == field
