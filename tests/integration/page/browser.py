"""Debian's Chromium, driven by Playwright: what somebody sees of the page, and does on it."""

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, Literal

from playwright.async_api import Browser, Page, ViewportSize, async_playwright

from tests.missing import require_debian
from tests.services.monitor.web.serving import Served

CHROMIUM: Final = "/usr/bin/chromium"
PATIENCE_MS: Final = 60_000
SIZES: Final = {"phone": (375, 812), "tablet": (1024, 768), "desk": (1440, 900), "wall": (1920, 1080)}

Size = Literal["phone", "tablet", "desk", "wall"]
Scheme = Literal["dark", "light"]


@asynccontextmanager
async def open_browser(*more: str) -> AsyncIterator[Browser]:
    """Start Chromium, with more options; skip, or fail in CI, where it is missing."""
    require_debian("Chromium", [CHROMIUM], how="tests/install/chromium.sh installs it")
    async with async_playwright() as playwright:
        options = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", *more]
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        try:
            yield browser
        finally:
            await browser.close()


class Looker:
    """Somebody who looks at a served monitor with a browser, and is logged in.

    errors: what went wrong in the browser. elsewhere: what it fetched from anywhere but the monitor.
    """

    def __init__(self, page: Page, at: Served, pictures: Path) -> None:
        self.page = page
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self._at = at
        self._pictures = pictures
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._requested)

    async def go(self, path: str) -> Page:
        """Open one of the monitor's pages."""
        await self.page.goto(f"{self._at.url}{path}", wait_until="domcontentloaded")
        await self.page.locator(".fs-brand").wait_for()
        return self.page

    async def picture(self, name: str) -> None:
        """Take a screenshot, into $FLEETSIGHT_SCREENSHOTS where that is given."""
        self._pictures.mkdir(parents=True, exist_ok=True)
        await self.page.screenshot(path=self._pictures / f"{name}.png", animations="disabled")

    def _requested(self, request: object) -> None:
        url = str(getattr(request, "url", ""))
        if not url.startswith((self._at.url, self._at.url.replace("http", "ws", 1), "data:", "blob:")):
            self.elsewhere.append(url)


@asynccontextmanager
async def looking(
    browser: Browser, at: Served, folder: Path, *, size: Size = "desk", scheme: Scheme = "light", touch: bool = False
) -> AsyncIterator[Looker]:
    """Open a browser window of a size; when it closes nothing may have gone wrong in it, or come from elsewhere."""
    width, height = SIZES[size]
    viewport: ViewportSize = {"width": width, "height": height}
    context = await browser.new_context(
        viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch, ignore_https_errors=True
    )
    context.set_default_timeout(PATIENCE_MS)
    name, value = at.cookie
    await context.add_cookies([{"name": name, "value": value, "url": at.url}])
    looker = Looker(await context.new_page(), at, Path(os.environ.get("FLEETSIGHT_SCREENSHOTS") or folder))
    try:
        yield looker
    finally:
        await context.close()
    assert not looker.errors
    assert not looker.elsewhere
