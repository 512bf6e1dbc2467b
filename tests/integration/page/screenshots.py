"""The pictures that the documentation shows of the monitor's page, taken of the demo: `make screenshots`."""

import argparse
import asyncio
import re
import sys
from asyncio.subprocess import PIPE, STDOUT, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import cv2
import numpy as np
from playwright.async_api import Browser, BrowserContext, Error, Page, async_playwright

CHROMIUM: Final = "/usr/bin/chromium"
OPTIONS: Final = ("--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
FOLDER: Final = Path(__file__).parents[3] / "docs" / "screenshots"
DESK: Final = (1280, 800)
PHONE: Final = (390, 844)
START_S: Final = 300
PATIENCE_MS: Final = 120_000
MOST_BYTES: Final = 300_000
NOTHING: Final = r"(?!)"


@dataclass(frozen=True)
class Shot:
    """One picture. ready: what is to be on the page first. click: what is clicked then. settle_s: how long it rests."""

    name: str
    path: str
    ready: str
    scheme: Literal["light", "dark"] = "light"
    size: tuple[int, int] = DESK
    click: str = ""
    settle_s: float = 4


FRESH: Final = ".fs-picture:not(.fs-old)"
SHOTS: Final = (
    Shot("overview", "/", "[data-robot=r3] .fs-chip"),
    Shot("overview-dark", "/", "[data-robot=r3] .fs-chip", "dark"),
    Shot("overview-phone", "/", "[data-robot=r3] .fs-chip", "dark", PHONE),
    Shot("camera", "/cameras/r1/camera", FRESH, click="text=Masks", settle_s=6),
    Shot("camera-dark", "/cameras/r2/camera", FRESH, "dark"),
    Shot("camera-phone", "/cameras/r1/camera", FRESH, "dark", PHONE),
    Shot("objects", "/objects/r1/camera", "button.fs-row", "dark", settle_s=8),
    Shot("map", "/map", ".fs-map .robot.live", settle_s=8),
    Shot("map-dark", "/map", ".fs-map .robot.live", "dark", settle_s=8),
    Shot("inventory", "/in-view", "[data-sighting]", click="[data-sighting] button"),
    Shot("alerts", "/alerts", "[data-alert]"),
    Shot("health-dark", "/health", "[data-worker]", "dark"),
)


@dataclass(frozen=True)
class Demo:
    """A demo that runs: where its page is, and who may log in."""

    url: str
    name: str
    password: str


@asynccontextmanager
async def demo(hz: float) -> AsyncIterator[Demo]:
    """Run `make demo`'s command."""
    command = ("-m", "services.toolbox", "demo", "--robots", "3", "--hz", str(hz))
    process = await asyncio.create_subprocess_exec(sys.executable, *command, stdout=PIPE, stderr=STDOUT)
    try:
        async with asyncio.timeout(START_S):
            found = await _read_until(process, r"page: (\S+) \(log in as (\S+) with (\S+)\)")
        reading = asyncio.create_task(_read_until(process, NOTHING))
        yield Demo(*found)
        reading.cancel()
    finally:
        if process.returncode is None:
            process.terminate()
        await process.wait()


async def _read_until(process: Process, pattern: str) -> tuple[str, ...]:
    assert process.stdout is not None
    async for line in process.stdout:
        found = re.search(pattern, line.decode(errors="replace"))
        if found:
            return found.groups()
    raise RuntimeError("the demo ended")


async def log_in(browser: Browser, at: Demo) -> BrowserContext:
    """Log in, as a person would; return the window in which they are."""
    context = await browser.new_context()
    context.set_default_timeout(PATIENCE_MS)
    page = await context.new_page()
    await page.goto(f"{at.url}/login")
    await page.locator("input[name=name]").fill(at.name)
    await page.locator("input[name=password]").fill(at.password)
    await page.locator("button").click()
    await page.locator(".fs-brand").wait_for()
    await page.goto("about:blank")
    return context


async def take(browser: Browser, logged_in: BrowserContext, url: str, shot: Shot) -> Path:
    """Take one picture; raises playwright's Error if what it should show does not come."""
    width, height = shot.size
    context = await browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=shot.scheme,
        storage_state=await logged_in.storage_state(),
    )
    context.set_default_timeout(PATIENCE_MS)
    try:
        page = await context.new_page()
        await page.goto(url + shot.path, wait_until="domcontentloaded")
        return await _picture(page, shot)
    finally:
        await context.close()


async def _picture(page: Page, shot: Shot) -> Path:
    await page.locator(shot.ready).first.wait_for()
    if shot.click:
        await page.locator(shot.click).first.click()
    await page.wait_for_timeout(shot.settle_s * 1000)
    await page.locator(shot.ready).first.wait_for()
    pixels = cv2.imdecode(np.frombuffer(await page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    return await asyncio.to_thread(_keep, pixels, FOLDER / f"{shot.name}.webp")


def _keep(pixels: np.ndarray, path: Path) -> Path:
    """Write as WebP, as good as MOST_BYTES allow."""
    tries = (
        cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes() for quality in (90, 75, 60, 40)
    )
    data = next(each for each in tries if len(each) < MOST_BYTES)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


async def main(names: list[str], hz: float) -> int:
    """Take the pictures, all unless some are named; return how many could not be taken."""
    failed = 0
    async with async_playwright() as playwright, demo(hz) as at:
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=list(OPTIONS))
        logged_in = await log_in(browser, at)
        for shot in (each for each in SHOTS if not names or each.name in names):
            try:
                path = await take(browser, logged_in, at.url, shot)
                sys.stdout.write(f"{path.name}: {path.stat().st_size / 1000:.0f} kB\n")
            except Error as error:
                failed += 1
                sys.stdout.write(f"{shot.name}: {str(error).splitlines()[0]}\n")
        await browser.close()
    return failed


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="the pictures to take; all unless given")
    parser.add_argument("--hz", type=float, default=2.0, help="images per second and robot; fewer on a busy machine")
    given = parser.parse_args()
    sys.exit(bool(asyncio.run(main(given.names, given.hz))))
