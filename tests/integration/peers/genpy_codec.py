"""Says what Debian's genpy makes of message types; run under the system's Python.

Reads lines of a type's name and a message in hexadecimal. Prints for each a line of JSON: the type's own md5sum and
whole definition, and the message as genpy writes it after reading it.
"""

import json
import sys
from importlib import import_module
from io import BytesIO
from typing import Any


def class_of(name: str) -> Any:
    """Return the class of a message, or of a service's request or response."""
    package, short = name.split("/")
    kind = "srv" if package == "std_srvs" else "msg"
    return getattr(import_module(f"{package}.{kind}"), short)


def answer(name: str, data: bytes) -> dict[str, str]:
    """Return what genpy says of one message."""
    kind = class_of(name)
    written = BytesIO()
    kind().deserialize(data).serialize(written)
    return {"name": name, "md5sum": kind._md5sum, "definition": kind._full_text, "data": written.getvalue().hex()}


def service(name: str) -> dict[str, str]:
    """Return what genpy says of a service."""
    return {"name": name, "md5sum": class_of(name)._md5sum}


for line in sys.stdin:
    words = line.split()
    said = service(words[0]) if words[1:] == ["service"] else answer(words[0], bytes.fromhex("".join(words[1:])))
    sys.stdout.write(json.dumps(said) + "\n")
