"""What of a page is cut off by what it is in, or lies where one has to scroll sideways for it."""

from typing import Final

from playwright.async_api import Page

FIND: Final = """() => {
  const found = [];
  const context = document.createElement("canvas").getContext("2d");
  const named = (element) => [element.tagName.toLowerCase(), ...element.classList].slice(0, 3).join(".");
  const said = (element) =>
    (element.innerText || element.getAttribute("aria-label") || element.placeholder || "").trim();
  const isWhole = (element, clip) =>
    getComputedStyle(clip).textOverflow === "ellipsis" && element.closest("[title]")?.title.includes(said(element));

  function check(element, { left, right, top, bottom }) {
    if (right === left || bottom === top) return;
    const box = { left, right, top, bottom };
    for (let clip = element; clip && clip !== document.body; clip = clip.parentElement) {
      const style = getComputedStyle(clip);
      const edge = clip.getBoundingClientRect();
      if (isWhole(element, clip)) {
        box.left = Math.max(box.left, edge.left);
        box.right = Math.min(box.right, edge.right);
        box.top = Math.max(box.top, edge.top);
        box.bottom = Math.min(box.bottom, edge.bottom);
      }
      const aside = Math.max(edge.left - box.left, box.right - edge.right);
      const below = Math.max(edge.top - box.top, box.bottom - edge.bottom);
      const cutAside = style.overflowX !== "visible" && aside > 1;
      const cutBelow = ["hidden", "clip"].includes(style.overflowY) && below > 2;
      if (cutAside || cutBelow)
        found.push(`${said(element)}: ${Math.round(Math.max(aside, below))} px outside ${named(clip)}`);
      if (style.position === "fixed") break;
    }
    if (box.left < -1 || box.right > innerWidth + 1)
      found.push(`${said(element)}: ${Math.round(box.left)} to ${Math.round(box.right)} of ${innerWidth}`);
  }

  for (const element of document.body.querySelectorAll("*")) {
    if (!element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (element.closest("svg, [aria-hidden=true], .q-tooltip, script, style, noscript")) continue;
    if (element.matches("button, a, input, [role=button], [role=switch]"))
      check(element, element.getBoundingClientRect());
    if (element.placeholder) {
      context.font = getComputedStyle(element).font;
      const wide = context.measureText(element.placeholder).width;
      if (wide > element.clientWidth + 1) found.push(`${element.placeholder}: ${wide} px in ${element.clientWidth}`);
    }
    for (const text of element.childNodes) {
      if (text.nodeType !== Node.TEXT_NODE || !text.textContent.trim()) continue;
      const range = document.createRange();
      range.selectNodeContents(text);
      check(element, range.getBoundingClientRect());
    }
  }
  return [...new Set(found)];
}"""


async def out_of_sight(page: Page) -> list[str]:
    """Return each text, link, button and field that is cut off or outside what is scrolled sideways, and by how much.

    What ends in an ellipsis and has all of it as its title counts as whole.
    """
    found: list[str] = await page.evaluate(FIND)
    return found
