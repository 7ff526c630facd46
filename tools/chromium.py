"""Debian's Chromium without a display, drawing in software, for tests and pictures of the window."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = "/usr/bin/chromium"
_FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
)

# Where a node of the scene is on the screen.
PLACE = """name => {
    const viewer = window.__viserMutable, node = viewer.nodeRefFromName[name];
    const at = node.getWorldPosition(node.position.clone()).project(viewer.camera);
    const box = viewer.canvas.getBoundingClientRect();
    return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
}"""
# The vertices of a mesh of the scene, one number after the other.
VERTICES = """name => {
    let found = null;
    window.__viserMutable.nodeRefFromName[name].traverse(own => { if (found === null && own.isMesh) found = own; });
    return Array.from(found.geometry.attributes.position.array);
}"""
# Its first colours.
COLOURS = """name => {
    let found = null;
    window.__viserMutable.nodeRefFromName[name].traverse(own => { if (found === null && own.isMesh) found = own; });
    return Array.from(found.geometry.attributes.color.array);
}"""
# Leaves the triangles out and everything else in, as a graphics card would at best: what is drawn in software costs
# the cores on which the simulation runs.
WITHOUT_TRIANGLES = """for (const kind of [WebGLRenderingContext, WebGL2RenderingContext])
    for (const call of ["drawElements", "drawRangeElements", "drawElementsInstanced", "drawArrays",
                        "drawArraysInstanced"])
        if (kind.prototype[call]) kind.prototype[call] = () => {};
"""
DRAWN = "() => window.__softprint && window.__softprint.coloured > 0"


@contextmanager
def browser() -> Iterator[Any]:
    """A browser; `new_page()` opens a tab."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        own = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=_FLAGS.split())
        try:
            yield own
        finally:
            own.close()


def open_window(
    own: Any,
    address: str,
    width: int,
    height: int,
    patience: float = 60.0,
    detail: float = 1.0,
    first: str = "",
) -> Any:
    """A tab with the window, drawn, and without the notice that it is drawn in software. detail: pixels drawn for each
    pixel of its width; fewer cost less. first: a script that runs before those of the page."""
    page = own.new_page(viewport={"width": width, "height": height}, device_scale_factor=detail)
    page.set_default_timeout(1e3 * patience)
    if first:
        page.add_init_script(first)
    page.goto(address)
    page.wait_for_function(DRAWN)
    notice = page.locator(".mantine-Notification-closeButton")
    if notice.count():
        notice.first.click()
    return page
