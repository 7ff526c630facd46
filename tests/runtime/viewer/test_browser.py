"""The window in a real browser: opened, pressed with the mouse, switched, recorded, reloaded, and ended by Ctrl-C."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tools.chromium import COLOURS, PLACE, VERTICES, browser, open_window

PATIENCE = 60.0  # s for anything, on a machine that is busy
DETAIL = 0.3  # of pixels: drawing in software is most of the time of this test


@pytest.fixture
def served(toy3d):
    """The process of `softprint view` and the address of its page."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "softprint.runtime.cli.main", "view", str(toy3d.experiment)),
            *("--out", str(toy3d.out), "--port", "0", "--no-open", "--quiet", "--model", "bare"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        line = ""
        while "http://" not in line:
            line = process.stdout.readline()
            assert line, process.stderr.read()
        yield process, re.search(r"http://127\.0\.0\.1:\d+", line)[0]
    finally:
        process.kill()
        process.wait()


def wait_for(what, patience: float = PATIENCE):
    end = time.monotonic() + patience
    while not (found := what()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)
    return found


def force(page) -> float:
    """The contact force that the window shows [N]; the largest, where two models play."""
    return max(map(float, re.findall(r"([0-9.]+) N\b", page.inner_text("#softprint-status"))), default=0.0)


def vertices(page) -> np.ndarray:
    return np.array(page.evaluate(VERTICES, "/body_0")).reshape(-1, 3)


def drag(page, name: str, across: float, down: float) -> None:
    """Take hold of a node of the scene with the mouse, move it by so many pixels, and hold."""
    x, y = page.evaluate(PLACE, name)
    page.mouse.move(x - 4, y + 3)
    page.mouse.down()
    for share in np.linspace(0.1, 1.0, 10):
        page.mouse.move(x - 4 + share * across, y + 3 + share * down)
        time.sleep(0.04)


def press(page, name: str, across: float, down: float) -> None:
    """`drag` until there is a force. On a busy machine a click can come before the page takes any: then once more."""
    for _ in range(3):
        drag(page, name, across, down)
        end = time.monotonic() + PATIENCE / 3
        while time.monotonic() < end:
            if force(page) > 0.3:
                return
            time.sleep(0.05)
        page.mouse.up()
    raise AssertionError(f"no force after three drags; the window says {page.inner_text('#softprint-status')!r}")


def choose(page, present: str, wanted: str) -> None:
    """Choose in the first list that shows `present`."""
    page.locator(f"input[value='{present}']").first.click()
    page.get_by_role("option", name=wanted, exact=True).last.click()


@pytest.mark.slow
def test_a_press_by_hand(served, toy3d):
    process, address = served
    with browser() as own:
        page = open_window(own, address, 720, 480, PATIENCE, DETAIL)
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        rest, pale = vertices(page), page.evaluate(COLOURS, "/body_0")
        assert force(page) == 0.0

        # Down with the mouse, onto the block: the force rises, the mesh gives way, the colours change.
        press(page, "/colliders/ball_0", 0.0, 60.0)
        wait_for(lambda: np.abs(vertices(page) - rest).max() > 1e-3)  # m
        assert page.evaluate(COLOURS, "/body_0") != pale
        page.mouse.up()

        # The trained model in place of the bare one; a second tab sees the same.
        choose(page, "bare", "ours")
        wait_for(lambda: "ours" in page.inner_text("#softprint-status"))
        other = open_window(own, address, 480, 360, PATIENCE, DETAIL)
        wait_for(lambda: "ours" in other.inner_text("#softprint-status"))

        # A wild mouse, in one tab while the other is closed, and a reload.
        drag(page, "/colliders/ball_0", -200.0, 150.0)
        other.close()
        for x, y in np.random.default_rng(1).uniform(0, 400, (30, 2)):
            page.mouse.move(x, y)
        page.mouse.up()
        page.reload()
        page.wait_for_function("() => window.__softprint && window.__softprint.coloured > 0")
        wait_for(lambda: "ours" in page.inner_text("#softprint-status"))

        # A recording, which is still in progress when Ctrl-C comes.
        page.get_by_role("button", name="record", exact=True).click()
        wait_for(lambda: "recording" in page.inner_text("#softprint-status"))
        time.sleep(0.5)
        began = time.monotonic()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
        assert time.monotonic() - began < 30.0
        assert process.returncode == 0
        assert "Traceback" not in err + out
        assert "recorded" in out
        assert list((toy3d.out / "recordings").glob("hand_*_ours.h5"))
        assert problems == []
