import json
import time

import pytest
from pydantic import BaseModel

from schemas.keys import CameraKey
from services.monitor.fleet import Fleet
from services.monitor.snapshot import FleetView, Workers
from services.monitor.web.api.bodies import Body, camera_body, encoded, page_response, robot_body, sighting_body
from services.monitor.web.api.models import CameraAnswer, Page, RobotAnswer, SightingAnswer
from tests.services.monitor.web.api.seeing import fill

NOW = 1_700_000_000_123_456_789


@pytest.fixture(scope="module")
def bodies() -> list[tuple[type[BaseModel], Body]]:
    """One of each list, of a robot that is there and of one that never said anything."""
    fleet = Fleet("clock")
    fill(fleet)
    now_ns = time.time_ns()
    fleet_view = FleetView(fleet, Workers(fleet, now_ns), now_ns, time.monotonic())
    (entry,) = fleet.inventory.entries(now_ns)
    return [
        *((RobotAnswer, robot_body(fleet_view.robot(name))) for name in fleet_view.robots),
        *((CameraAnswer, camera_body(fleet_view.camera(CameraKey(name, "front")))) for name in fleet_view.robots),
        (SightingAnswer, sighting_body(entry)),
    ]


def test_what_is_sent_is_what_the_document_says(bodies: list[tuple[type[BaseModel], Body]]) -> None:
    for model, body in bodies:
        described = model.model_json_schema(mode="serialization", by_alias=True)["properties"]
        assert set(body) == set(described)
        sent = json.loads(encoded(body))
        by_name = {("name" if key == "class" and model is SightingAnswer else key): sent[key] for key in sent}
        assert json.loads(model.model_validate(by_name).model_dump_json(by_alias=True)) == sent


def test_a_page_is_what_the_document_says() -> None:
    sent = bytes(page_response(NOW, [{"name": "x"}], "mark").body)
    page = Page[dict[str, str]].model_validate_json(sent)
    assert (page.items, page.next) == ([{"name": "x"}], "mark")
    assert json.loads(page.model_dump_json()) == json.loads(sent)
    assert json.loads(bytes(page_response(0, [], None).body)) == {
        "now": "1970-01-01T00:00:00Z",
        "items": [],
        "next": None,
    }
