"""The page's own TLS: a certificate and its key, taken anew when they change."""

import asyncio
import logging
import ssl
from pathlib import Path

from bus import BusError
from bus.session.certificates import check_pair
from bus.session.changed_files import LOOKED_AT_S, ChangedFiles

log = logging.getLogger(__name__)


class PageTls:
    """The context of the server's connections. Those that are open keep the certificate that they began with.

    Raises:
        BusError: a file cannot be used; the message names its setting.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self._pair = certificate, key
        self._files = ChangedFiles(self._pair)
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        check_pair(*self._named_pair)
        self._load()

    async def keep_current(self) -> None:
        """Take changed files, forever; those that cannot be used are named in the log and left."""
        while True:
            await asyncio.sleep(LOOKED_AT_S)
            if not await asyncio.to_thread(self._files.changed):
                continue
            self._files.use()
            try:
                await asyncio.to_thread(check_pair, *self._named_pair)
                self._load()  # here, where connections begin: between certificate and key they would fail
            except (BusError, OSError) as error:
                log.warning("%s; the page uses the previous certificate until this is fixed", error)
            else:
                log.info("the page's certificate has changed; new connections use it")

    @property
    def _named_pair(self) -> tuple[str, Path, str, Path]:
        certificate, key = self._pair
        return "web_certificate", certificate, "web_key", key

    def _load(self) -> None:
        certificate, key = self._pair
        self.context.load_cert_chain(certificate, key, password="")
