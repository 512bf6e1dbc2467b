"""Files to publish, and how a test publishes them without a bus."""

import hashlib

from schemas.models import PIECE_BYTES, ModelUpload, PublishedModel, pieces_of
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
