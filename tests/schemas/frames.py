"""Messages for tests."""

from schemas.header import Header
from schemas.image import ImageFrame


def header(*, robot: str = "r1", camera: str = "front", seq: int = 0) -> Header:
    return Header(
        robot=robot,
        camera=camera,
        boot_id="boot",
        seq=seq,
        stamp_ns=1_700_000_000_000_000_000 + seq,
        frame_id="camera_color_optical_frame",
        received_ns=1_700_000_000_100_000_000 + seq,
    )


def image(*, height: int = 4, width: int = 6, encoding: str = "rgb8", seq: int = 0) -> ImageFrame:
    step = width * 3
    data = memoryview(bytes(range(256)) * (step * height // 256 + 1))[: step * height]
    return ImageFrame(header=header(seq=seq), height=height, width=width, encoding=encoding, step=step, data=data)
