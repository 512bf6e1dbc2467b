"""The socket that the web server listens on, taken before anything else begins."""

import errno
import ipaddress
import os
import socket
from typing import Final

from services.monitor.web.errors import WebError
from services.monitor.web.settings import WebSettings

_OF_PORTS: Final = (errno.EADDRINUSE, errno.EACCES)
"""What another port may mend."""


def open_listener(settings: WebSettings) -> socket.socket:
    """Listen where the settings say.

    Raises:
        WebError: the address or port cannot be had.
    """
    where = f"--web-host {settings.web_host} --web-port {settings.web_port}"
    try:
        found = socket.getaddrinfo(
            settings.web_host, settings.web_port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        family, _, _, _, address = found[0]
        listener = socket.create_server((str(address[0]), int(address[1])), family=family)
    except (OSError, UnicodeError) as error:
        number = error.errno if isinstance(error, OSError) else None
        of_names = error.strerror if isinstance(error, socket.gaierror) else str(error)
        reason = os.strerror(number) if number is not None and number > 0 else of_names
        wrong = "--web-port" if number in _OF_PORTS else "--web-host"
        raise WebError(f"{where}: {reason}; another {wrong}, or --no-web, lets it start") from error
    listener.setblocking(False)  # noqa: FBT003 - the standard library's
    return listener


def url_of(listener: socket.socket, settings: WebSettings) -> str:
    """Return the address to write into a browser's bar, without a slash at its end."""
    if settings.web_url is not None:
        return str(settings.web_url).rstrip("/")
    host, port = listener.getsockname()[:2]
    if ipaddress.ip_address(host).is_unspecified:
        host = socket.gethostname()
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
