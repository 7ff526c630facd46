"""Opens the page in the browser of the user, if there is one."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Callable


def announce(address: str, open_browser: bool, say: Callable[[str], None]) -> None:
    """Say where the page is, and open it. Without a display, or a browser, it is only said."""
    say(f"The window is at {address} (Ctrl-C ends it).")
    sys.stdout.flush()  # programs that read it wait for the address
    if not open_browser:
        return
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER")):
        say("There is no display here, so no browser is opened: open that address in one on this machine.")
        return

    def opened() -> None:
        try:
            found = webbrowser.open(address)
        except webbrowser.Error:
            found = False
        if not found:
            say("No browser was found: open that address in one.")

    # A browser in a terminal would not return.
    threading.Thread(target=opened, name="browser", daemon=True).start()
