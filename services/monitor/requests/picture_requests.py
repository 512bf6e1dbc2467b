"""Has `fleetsight collect --asked` save pictures of cameras."""

from typing import Final

from bus import Bus, BusError, NotServedError
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.keys import CameraKey
from schemas.models import PictureRequest, SavedPicture

PICTURE_S: Final = 25.0
"""Time for a picture and the answer of a detector worker to it."""


class SavePictureError(Exception):
    """A picture was not saved; the message says why, and what helps."""


async def save_picture(bus: Bus, camera: CameraKey, by: str) -> SavedPicture:
    """Have a picture of a camera saved by a `fleetsight collect --asked`. by: who asks for it.

    Raises:
        SavePictureError: none runs, or it did not save it.
    """
    asked = codec.encode(PictureRequest(robot=camera.robot, camera=camera.camera, by=by))
    encoding = codec.encoding(PictureRequest)
    try:
        reply = await bus.request(keys.COLLECT, asked, encoding=encoding, timeout_s=PICTURE_S)
        return codec.decode(SavedPicture, reply.payload, reply.encoding)
    except NotServedError as error:
        raise SavePictureError("nobody collects pictures: run fleetsight collect FOLDER --asked") from error
    except (BusError, SchemaError) as error:
        raise SavePictureError(str(error)) from error
