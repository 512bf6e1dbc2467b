"""Method dispatch of a ROS API by name, with checked parameters."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, get_origin

from gateway.ros1.errors import ERROR, StatusError, UnknownMethodError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


class Methods:
    """Calls methods by name; the first parameter of each is the caller's name.

    handlers: return the message and the value of a successful answer. The annotations of their parameters are classes,
        of which what comes must be an instance, or Any.
    """

    def __init__(self, handlers: Mapping[str, Callable[..., tuple[str, Any]]]) -> None:
        self._handlers = handlers
        self._signatures = {name: inspect.signature(handler, eval_str=True) for name, handler in handlers.items()}

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Answer one call. Other exceptions of a handler are passed on.

        Raises:
            StatusError: the parameters do not fit, or the handler says so.
            UnknownMethodError: there is no such method.

        """
        if method not in self._handlers:
            raise UnknownMethodError(f"no method {method[:80]!r}")
        if not params or not isinstance(params[0], str):
            raise StatusError(ERROR, "the first parameter is the caller's name")
        signature = self._signatures[method]
        try:
            named = signature.bind(*params).arguments
        except TypeError as error:
            raise StatusError(ERROR, f"wrong parameters: {error}") from error
        for name, value in named.items():
            if not _fits(value, signature.parameters[name].annotation):
                raise StatusError(ERROR, f"wrong parameters: {name} must not be of type {type(value).__name__}")
        return self._handlers[method](*params)


def _fits(value: Any, annotation: Any) -> bool:
    if annotation in (Any, inspect.Parameter.empty):
        return True
    return isinstance(value, get_origin(annotation) or annotation)
