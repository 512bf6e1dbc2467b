"""Fetches a published model from the registry, one piece after the other."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from bus import Bus, RequestError
from schemas import codec
from schemas.models import PIECE_BYTES, ModelPiece, ModelPieceRequest, PublishedModel, piece_bytes, pieces_of
from schemas.worker_keys import ModelKey
from services.model_registry.client import PIECE_S


async def fetch_rest(bus: Bus, model: PublishedModel, file: Path, progress: Callable[[int], None]) -> None:
    """Append to a file the pieces that it lacks; the caller then checks it by its digest.

    One piece is in flight at a time: more would queue on the link before the fleet's own messages. progress: is told
    the number of bytes that are there, after each piece, and may raise.

    Raises:
        RequestError: the registry does not answer, or has no such model.
        SchemaError: an answer cannot be read.
        OSError: the file cannot be written.
    """
    with await asyncio.to_thread(file.open, "ab") as written:
        first = await asyncio.to_thread(_whole_pieces, written)
        for index in range(first, pieces_of(model.size)):
            piece = await _piece(bus, model, index)
            await asyncio.to_thread(_append, written, piece)
            progress(index * PIECE_BYTES + len(piece))


async def _piece(bus: Bus, model: PublishedModel, index: int) -> memoryview:
    asked = ModelPieceRequest(digest=model.digest, index=index)
    reply = await bus.request(
        ModelKey.PIECE, codec.encode(asked), encoding=codec.encoding(ModelPieceRequest), timeout_s=PIECE_S
    )
    piece = codec.decode(ModelPiece, reply.payload, reply.encoding)
    if (piece.digest, piece.index, len(piece.data)) != (model.digest, index, piece_bytes(model.size, index)):
        raise RequestError(f"piece {index} of {model.label} came as another one, or with {len(piece.data)} bytes")
    return piece.data


def _whole_pieces(file: BinaryIO) -> int:
    """Cut off a piece that was written in part; return how many are whole."""
    pieces = file.tell() // PIECE_BYTES
    file.truncate(pieces * PIECE_BYTES)
    return pieces


def _append(file: BinaryIO, piece: memoryview) -> None:
    file.write(piece)
    file.flush()
