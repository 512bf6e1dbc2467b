"""What of a page is too small for a finger."""

from typing import Final

from playwright.async_api import Page

LEAST_PX: Final = 44

FIND: Final = """(least) => {
  const found = [];
  for (const element of document.body.querySelectorAll("a, button, .q-field__control, [role=button], [role=switch]")) {
    if (!element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (element.matches("[aria-hidden=true], [aria-hidden=true] *")) continue;
    if (element.matches(".fs-map .things a")) continue;  // at true size; the list beside them has the same links
    const box = element.getBoundingClientRect();
    if (!box.width || (box.width > least - 0.5 && box.height > least - 0.5)) continue;
    const said = element.innerText || element.getAttribute("aria-label") || element.className;
    found.push(`${said}: ${Math.round(box.width)} x ${Math.round(box.height)}`);
  }
  return [...new Set(found)];
}"""


async def too_small_to_touch(page: Page) -> list[str]:
    """Return each link, button, switch and field that is less than LEAST_PX high or wide, and how large it is."""
    found: list[str] = await page.evaluate(FIND, LEAST_PX)
    return found
