import asyncio

import msgspec
import pytest

from bus import QUEUE
from bus.fake import FakeNetwork
from schemas import worker_keys
from schemas.status import WorkerStatus
from schemas.tuning import Tuning
from schemas.worker_keys import WorkerAlive
from services.detector.process import DetectorWorker
from services.detector.tuning import deviations
from tests.services.detector.support.fakes import FakeModel
from tests.waiting import receive

CONFIGURED = Tuning(confidence=0.25, iou=0.7, max_detections=300, classes=[])


@pytest.mark.parametrize(
    ("changed", "remark"),
    [
        ({"confidence": 1.0}, "confidence 1, not 0.25"),
        ({"max_detections": 5, "classes": ["box", "pallet"]}, "max_detections 5, not 300; classes box pallet, not all"),
    ],
)
def test_what_differs_from_the_configured_settings_is_said(changed: dict[str, object], remark: str) -> None:
    assert deviations(CONFIGURED, msgspec.structs.replace(CONFIGURED, **changed)) == [
        f"settings changed by a request: {remark}"
    ]


def test_configured_settings_are_no_remark() -> None:
    assert deviations(CONFIGURED, msgspec.structs.replace(CONFIGURED)) == []


async def test_a_workers_status_says_that_its_settings_were_changed_until_they_are_restored() -> None:
    network, model = FakeNetwork(), FakeModel()
    configured = model.tuning
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.subscribe(worker_keys.EVERY_WORKER_STATUS, QUEUE(9)) as statuses,
        asyncio.TaskGroup() as group,
    ):
        worker = DetectorWorker(ours, model, [WorkerAlive("detector", "w1")], max_age_s=60, join_s=0)
        working = group.create_task(worker.run())
        assert not (await receive(statuses, WorkerStatus)).remarks
        model.tune(Tuning(confidence=1.0))
        while not (remarks := (await receive(statuses, WorkerStatus)).remarks):
            pass
        assert remarks == ["settings changed by a request: confidence 1, not 0.5"]
        model.tune(configured)
        while (await receive(statuses, WorkerStatus)).remarks:
            pass
        working.cancel()
