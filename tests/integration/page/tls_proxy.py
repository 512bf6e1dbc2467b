"""Debian's nginx as the proxy with TLS that stands before a monitor."""

import asyncio
import subprocess
from asyncio.subprocess import DEVNULL
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from tests.missing import require_debian

NGINX: Final = "/usr/sbin/nginx"
OPENSSL: Final = "/usr/bin/openssl"
PATIENCE_S: Final = 30

CONFIGURATION: Final = """
daemon off;
pid nginx.pid;
error_log error.log;
events {}
http {
  access_log off;
  client_body_temp_path body; proxy_temp_path proxy; fastcgi_temp_path fastcgi; uwsgi_temp_path uwsgi;
  scgi_temp_path scgi;
  map $http_upgrade $connection_upgrade { default upgrade; '' close; }
  server {
    listen 127.0.0.1:%(port)d ssl;
    ssl_certificate own.pem;
    ssl_certificate_key own.key;
    location / {
      proxy_pass http://127.0.0.1:%(behind)d;
      proxy_http_version 1.1;
      proxy_set_header Host $http_host;
      proxy_set_header X-Forwarded-For $remote_addr;
      proxy_set_header X-Forwarded-Proto https;
      proxy_set_header Upgrade $http_upgrade;
      proxy_set_header Connection $connection_upgrade;
    }
  }
}
"""


@asynccontextmanager
async def tls_proxy(folder: Path, port: int, behind: int) -> AsyncIterator[None]:
    """Pass on what comes to `port` of this machine over TLS to the port `behind` it, with a certificate of its own."""
    require_debian("nginx", [NGINX, OPENSSL], how="tests/install/nginx.sh installs it")
    names = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-days", "2"]
    key = ["-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", f"{folder}/own.key", "-out", f"{folder}/own.pem"]
    await asyncio.to_thread(subprocess.run, [OPENSSL, "req", *key, *names], check=True, stderr=DEVNULL)
    (folder / "nginx.conf").write_text(CONFIGURATION % {"port": port, "behind": behind}, encoding="utf-8")
    proxy = await asyncio.create_subprocess_exec(
        NGINX, "-p", folder, "-c", folder / "nginx.conf", stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not await _answers(port):
                assert proxy.returncode is None, (folder / "error.log").read_text(encoding="utf-8")
                await asyncio.sleep(0.05)
        yield
    finally:
        if proxy.returncode is None:
            proxy.terminate()
        await proxy.wait()


async def _answers(port: int) -> bool:
    try:
        _, writer = await asyncio.open_connection("127.0.0.1", port)
    except ConnectionError:
        return False
    writer.close()
    return True
