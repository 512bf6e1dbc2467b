import msgspec
import pytest

from schemas import codec
from schemas.keys import sensor_key
from schemas.status import GatewayStatus, StreamStatus, WorkerStatus


@pytest.mark.parametrize(
    ("camera", "stream", "name"), [("front", "depth", "front/depth"), ("", "ros/battery", "ros/battery")]
)
def test_a_stream_has_the_name_of_its_key(camera: str, stream: str, name: str) -> None:
    status = StreamStatus(camera=camera, stream=stream, topic="/t", wanted=True, publishers=1, received=0, forwarded=0)
    assert status.name == name == sensor_key("r1", name).name


@pytest.mark.parametrize(
    "status",
    [
        GatewayStatus(robot="r1", boot_id="b", clock_id="c", sent_ns=1, version="1.2"),
        WorkerStatus(service="detector", worker="w", model="m", sent_ns=1, version="1.2"),
    ],
    ids=lambda status: type(status).__name__,
)
def test_one_that_does_not_say_its_version_is_read(status: GatewayStatus | WorkerStatus) -> None:
    schema, said = type(status), msgspec.structs.asdict(status)
    del said["version"]
    read = codec.decode(schema, msgspec.msgpack.encode(said), codec.encoding(schema))
    assert read == msgspec.structs.replace(status, version="")
