"""Files to publish, and how a test publishes them with and without a bus."""

import hashlib
from pathlib import Path

from bus import Bus
from schemas.models import PIECE_BYTES, ModelUpload, PublishedModel, pieces_of
from services.model_registry.client import publish_model
from services.model_registry.registry import Registry

LONG = bytes(range(256)) * 2048 + b"the end"
"""Content of two pieces."""


def model_of(content: bytes, name: str) -> PublishedModel:
    return PublishedModel(digest=hashlib.sha256(content).hexdigest(), name=name, size=len(content), by="ann@desk")


def upload(model: PublishedModel, content: bytes, index: int = 0) -> ModelUpload:
    piece = content[index * PIECE_BYTES : (index + 1) * PIECE_BYTES]
    return ModelUpload(model=model, index=index, data=memoryview(piece))


def publish(registry: Registry, content: bytes, name: str, now_s: float = 0.0) -> PublishedModel:
    """Publish a whole content; return the model."""
    model = model_of(content, name)
    for index in range(pieces_of(model.size)):
        registry.take(upload(model, content, index), now_s)
    return model


async def publish_file(bus: Bus, folder: Path, content: bytes, name: str) -> str:
    """Publish a content from a file in a folder, over the bus; return its digest."""
    file, model = folder / name, model_of(content, name)
    file.write_bytes(content)
    await publish_model(bus, model, file, lambda _: None)
    return model.digest
