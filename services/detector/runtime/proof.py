"""Whether an engine is of use: it computes an empty image, and objects can be read off what it puts out."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.criteria import Criteria
from services.detector.runtime.engine import Engine
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.postprocess import Head, objects

ANYTHING: Final = Criteria(confidence=0, max_detections=1)
"""However unsure: every number of the output is looked at."""


def prove(engine: Engine, blank: NDArray[np.uint8], names: Mapping[int, str], stride: int, head: Head = "nms") -> None:
    """Compute an empty image, 1 x height x width x RGB, and read it as any other; names, stride, head are the model's.

    Raises:
        OutputError: nothing can be read off the output. What the engine raises beside it says that it does not work.
    """
    (output,) = engine.run(blank)
    height, width = blank.shape[1:3]
    as_it_is = Letterbox.fit(height, width, max(height, width), stride)
    objects(output, as_it_is, ANYTHING, names, masks=True, head=head)
