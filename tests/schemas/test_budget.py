import math

import msgspec
import pytest

from schemas import codec
from schemas.budget import LEAST_HZ, MOST_WAIT_S, RateBudget
from schemas.errors import SchemaError

FIELDS = {"robot": "r1", "camera": "front", "consumer": "w1", "stream": "color"}


def read(**fields: object) -> RateBudget:
    return codec.decode(RateBudget, msgspec.msgpack.encode(FIELDS | fields), codec.encoding(RateBudget))


@pytest.mark.parametrize("hz", [None, LEAST_HZ, 60.0])
@pytest.mark.parametrize("wait_s", [0.0, MOST_WAIT_S])
def test_what_can_be_asked_for(hz: float | None, wait_s: float) -> None:
    assert (read(hz=hz, wait_s=wait_s).hz, read(hz=hz, wait_s=wait_s).wait_s) == (hz, wait_s)


@pytest.mark.parametrize("hz", [0.0, -1.0, LEAST_HZ / 2, math.inf, math.nan, "2"])
def test_a_rate_is_some(hz: object) -> None:
    with pytest.raises(SchemaError):
        read(hz=hz)


@pytest.mark.parametrize("wait_s", [-0.1, MOST_WAIT_S * 2, math.inf, math.nan, None])
def test_a_wait_is_bounded(wait_s: object) -> None:
    with pytest.raises(SchemaError):
        read(hz=1.0, wait_s=wait_s)
