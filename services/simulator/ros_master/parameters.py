"""The master's parameter tree, and its subscribers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gateway.ros1.errors import ERROR, FAILURE, StatusError
from gateway.ros1.names import namespace_of

MAX_PARAMETER_BYTES = 8 << 20
_VALUE_BYTES = 64


@dataclass(frozen=True, slots=True)
class ParameterUpdate:
    """A paramUpdate call to make."""

    caller_api: str
    key: str
    value: Any


class ParameterTree:
    """Values by global name; a dict is a namespace. `{}` tells a subscriber that nothing is set.

    The whole tree holds at most `max_bytes`, counting 64 for each name and value, and the length of texts.
    """

    def __init__(self, max_bytes: int = MAX_PARAMETER_BYTES) -> None:
        self._max_bytes = max_bytes
        self._root: dict[str, Any] = {}
        self._size = _size({})
        self._subscribers: dict[str, dict[str, str]] = {}

    def get(self, key: str) -> Any:
        """Return a value or a whole namespace.

        Raises:
            LookupError: not set.

        """
        value: Any = self._root
        for part in _parts(key):
            value = _inside(value)[part]
        return value

    def has(self, key: str) -> bool:
        try:
            self.get(key)
        except LookupError:
            return False
        return True

    def set(self, key: str, value: Any, caller_id: str = "") -> list[ParameterUpdate]:
        """Set the value of a key; return the updates to send, except to the caller.

        Raises:
            StatusError: nothing is changed: the root can only become a namespace, or the tree would grow too large.

        """
        parts = _parts(key)
        if not parts:
            if not isinstance(value, dict):
                raise StatusError(ERROR, "the root of the parameters is a namespace")
            self._resize(_size(value) - self._size)
            self._root = value
        else:
            self._put(parts, value)
        return self._updates(_join(parts), value, caller_id)

    def delete(self, key: str) -> list[ParameterUpdate]:
        """Delete a key; return the updates to send.

        Raises:
            LookupError: not set, or the root.

        """
        parts = _parts(key)
        if not parts:
            raise LookupError("the root of the parameters cannot be deleted")
        namespace = _inside(self.get(_join(parts[:-1])))
        self._size -= _size_within(namespace, parts[-1])
        del namespace[parts[-1]]
        return self._updates(_join(parts), {}, "")

    def names(self) -> list[str]:
        """Return the names of all values that are not namespaces."""
        return _leaves("", self._root)

    def search(self, key: str, caller_id: str) -> str | None:
        """Return the full name of a key whose first part is set nearest to the caller, searching upwards."""
        if key.startswith("/"):
            return key if self.has(key) else None
        first = key.partition("/")[0]
        scope = caller_id.rstrip("/")
        while True:
            if self.has(f"{scope}/{first}"):
                return f"{scope}/{key}"
            if not scope:
                return None
            scope = namespace_of(scope).rstrip("/")

    def subscribe(self, key: str, caller_id: str, caller_api: str) -> Any:
        """Subscribe; return the current value, `{}` when not set."""
        self._subscribers.setdefault(_join(_parts(key)), {})[caller_api] = caller_id
        return self.get(key) if self.has(key) else {}

    def unsubscribe(self, key: str, caller_api: str) -> bool:
        """Unsubscribe; return whether there was such a subscription."""
        key = _join(_parts(key))
        subscribers = self._subscribers.get(key, {})
        found = subscribers.pop(caller_api, None) is not None
        if not subscribers:
            self._subscribers.pop(key, None)
        return found

    def forget(self, caller_api: str) -> None:
        """Drop all subscriptions of one node."""
        for key in list(self._subscribers):
            self.unsubscribe(key, caller_api)

    @property
    def subscription_count(self) -> int:
        return sum(len(subscribers) for subscribers in self._subscribers.values())

    def _put(self, parts: list[str], value: Any) -> None:
        """Set a value in the tree; namespaces are created on the way and replace plain values."""
        namespace, depth = self._root, 0
        while depth < len(parts) - 1 and isinstance(namespace.get(parts[depth]), dict):
            namespace = namespace[parts[depth]]
            depth += 1
        for part in reversed(parts[depth + 1 :]):
            value = {part: value}
        name = parts[depth]
        self._resize(_size_within({name: value}, name) - _size_within(namespace, name))
        namespace[name] = value

    def _resize(self, change: int) -> None:
        if change > 0 and self._size + change > self._max_bytes:
            raise StatusError(FAILURE, f"the parameters would exceed {self._max_bytes} bytes")
        self._size += change

    def _updates(self, key: str, value: Any, caller_id: str) -> list[ParameterUpdate]:
        updates = []
        for subscribed, subscribers in self._subscribers.items():
            if _is_within(key, subscribed):
                told, news = key, value
            elif _is_within(subscribed, key):
                told, news = subscribed, self.get(subscribed) if self.has(subscribed) else {}
            else:
                continue
            updates += [ParameterUpdate(api, told, news) for api, node in subscribers.items() if node != caller_id]
        return updates


def _size(value: Any) -> int:
    match value:
        case dict():
            return _VALUE_BYTES + sum(_size_within(value, name) for name in value)
        case list():
            return _VALUE_BYTES + sum(map(_size, value))
        case str() | bytes():
            return _VALUE_BYTES + len(value)
        case _:
            return _VALUE_BYTES


def _size_within(namespace: dict[str, Any], name: str) -> int:
    """Return the size of a namespace's entry, 0 without one."""
    return _size(name) + _size(namespace[name]) if name in namespace else 0


def _parts(key: str) -> list[str]:
    return [part for part in key.split("/") if part]


def _join(parts: list[str]) -> str:
    return "/" + "/".join(parts)


def _inside(value: Any) -> dict[str, Any]:
    """Return a value as a namespace; a plain value is an empty one."""
    return value if isinstance(value, dict) else {}


def _is_within(key: str, namespace: str) -> bool:
    return namespace in ("/", key) or key.startswith(f"{namespace}/")


def _leaves(prefix: str, namespace: dict[str, Any]) -> list[str]:
    names = []
    for part, value in namespace.items():
        name = f"{prefix}/{part}"
        names += _leaves(name, value) if isinstance(value, dict) else [name]
    return names
