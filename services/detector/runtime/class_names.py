"""Renames and merges the classes of a model. Pure."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

MAX_LISTED = 20


def renamed(names: Mapping[int, str], changes: Mapping[str, str]) -> dict[int, str]:
    """Return the names of a model's classes, by label, after changes from old names to new ones.

    Classes that get one name are one class from then on.
    """
    return {label: changes.get(name, name) for label, name in names.items()}


def merged(names: Mapping[int, str]) -> NDArray[np.int64] | None:
    """Return for each label the first label of the same name; None where each class has a name of its own."""
    first: dict[str, int] = {}
    labels = [first.setdefault(names[label], label) for label in sorted(names)]
    return None if len(first) == len(labels) else np.array(labels)


def listed(names: Iterable[str]) -> str:
    """Return names for a message: the first MAX_LISTED of them."""
    known = list(dict.fromkeys(names))
    return ", ".join([*known[:MAX_LISTED], *(["..."] if len(known) > MAX_LISTED else [])])
