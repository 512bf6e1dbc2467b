import pytest

from schemas.keys import sensor_key
from schemas.status import StreamStatus


@pytest.mark.parametrize(
    ("camera", "stream", "name"), [("front", "depth", "front/depth"), ("", "ros/battery", "ros/battery")]
)
def test_a_stream_has_the_name_of_its_key(camera: str, stream: str, name: str) -> None:
    status = StreamStatus(camera=camera, stream=stream, topic="/t", wanted=True, publishers=1, received=0, forwarded=0)
    assert status.name == name == sensor_key("r1", name).name
