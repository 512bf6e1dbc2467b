"""The master's parameter tree, and who is told about its changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gateway.ros1.names import namespace_of


@dataclass(frozen=True, slots=True)
class ParameterUpdate:
    """A paramUpdate call to make."""

    caller_api: str
    key: str
    value: Any


class ParameterTree:
    """Values by global name; a value that is a dict is a namespace. `{}` tells a subscriber that nothing is set."""

    def __init__(self) -> None:
        self._root: dict[str, Any] = {}
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
        """Replace what is at the key; return whom to tell, except the caller.

        Raises:
            TypeError: the root can only become a namespace.

        """
        parts = _parts(key)
        if not parts:
            if not isinstance(value, dict):
                raise TypeError("the root of the parameters is a namespace")
            self._root = value
        else:
            self._namespace(parts[:-1])[parts[-1]] = value
        return self._updates(_join(parts), value, caller_id)

    def delete(self, key: str) -> list[ParameterUpdate]:
        """Forget what is at the key; return whom to tell.

        Raises:
            LookupError: not set, or the root.

        """
        parts = _parts(key)
        if not parts:
            raise LookupError("the root of the parameters cannot be deleted")
        del _inside(self.get(_join(parts[:-1])))[parts[-1]]
        return self._updates(_join(parts), {}, "")

    def names(self) -> list[str]:
        """Return the names of all values that are no namespaces."""
        return _leaves("", self._root)

    def search(self, key: str, caller_id: str) -> str | None:
        """Return the full name of a key whose first part is set nearest to the caller, searched upwards."""
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
        """Return the value now, `{}` when not set."""
        self._subscribers.setdefault(_join(_parts(key)), {})[caller_api] = caller_id
        return self.get(key) if self.has(key) else {}

    def unsubscribe(self, key: str, caller_api: str) -> bool:
        """Return whether there was such a subscription."""
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

    def _namespace(self, parts: list[str]) -> dict[str, Any]:
        """Return the namespace, made where it is not; a plain value in its way is replaced."""
        namespace = self._root
        for part in parts:
            inner = namespace.get(part)
            if not isinstance(inner, dict):
                inner = namespace[part] = {}
            namespace = inner
        return namespace

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


def _parts(key: str) -> list[str]:
    return [part for part in key.split("/") if part]


def _join(parts: list[str]) -> str:
    return "/" + "/".join(parts)


def _inside(value: Any) -> dict[str, Any]:
    """Return the namespace that a value is; a plain value has nothing inside."""
    return value if isinstance(value, dict) else {}


def _is_within(key: str, namespace: str) -> bool:
    return namespace in ("/", key) or key.startswith(f"{namespace}/")


def _leaves(prefix: str, namespace: dict[str, Any]) -> list[str]:
    names = []
    for part, value in namespace.items():
        name = f"{prefix}/{part}"
        names += _leaves(name, value) if isinstance(value, dict) else [name]
    return names
