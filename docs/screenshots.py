"""A demo's folder in; the pictures of the report and of the app in the documentation, out.

    pycosim demo
    python docs/screenshots.py demo

Needs playwright, nicegui and Chromium.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

from PIL import Image
from playwright.sync_api import sync_playwright

IMAGES = Path(__file__).parent / "images"
SCALE, COLOURS, GAP, PORT = 0.75, 200, 24, 8765
LONG = 300_000  # ms


def write(name, parts):
    """Screenshots, one under the other with a gap between, small enough for a repository."""
    parts = [Image.open(io.BytesIO(p)).convert("RGB") for p in parts]
    height = sum(p.height for p in parts) + GAP * (len(parts) - 1)
    whole = Image.new("RGB", (max(p.width for p in parts), height), "white")
    for k, part in enumerate(parts):
        whole.paste(part, (0, sum(p.height + GAP for p in parts[:k])))
    size = int(whole.width * SCALE), int(whole.height * SCALE)
    whole.resize(size, Image.LANCZOS).quantize(COLOURS).save(IMAGES / f"{name}.png", optimize=True)


def report(browser, folder):
    """The answer, and what is missing point by point."""
    page = browser.new_page(viewport={"width": 1150, "height": 900}, color_scheme="light")
    page.goto((folder / "report.html").resolve().as_uri())
    page.wait_for_selector("html[data-ready=true]")
    chart = page.locator("article.card.accepted figure")
    chart.scroll_into_view_if_needed()
    chart.locator(".main-svg").first.wait_for()  # drawn once it is seen
    write("report", [page.locator("#verdict").screenshot(), chart.screenshot()])


def app(browser, folder):
    """The comparison, after the effect was added."""
    with tempfile.TemporaryDirectory() as out:
        server = subprocess.Popen([sys.executable, "-m", "pycosim.cli", "app", folder / "study.toml", "--no-browser",
                                   "--quiet", "--port", str(PORT), "--out", out])
        try:
            wait(f"http://127.0.0.1:{PORT}")
            page = browser.new_page(viewport={"width": 1200, "height": 1010}, color_scheme="light")
            page.goto(f"http://127.0.0.1:{PORT}")
            page.get_by_role("tab", name="Effects").click(timeout=LONG)
            page.get_by_role("button", name="Diagnose").click()
            page.get_by_role("button", name="Add stribeck at 2A", exact=True).click(timeout=LONG)
            page.get_by_text("study: + stribeck at 2A").wait_for(timeout=LONG)
            page.get_by_role("tab", name="Comparison").click()
            page.wait_for_timeout(3000)  # charts slide in
            write("app", [page.screenshot()])
        finally:
            server.kill()


def wait(address):
    """Until a server answers."""
    for _ in range(300):
        try:
            urlopen(address, timeout=10).close()
            return
        except (URLError, OSError):
            time.sleep(0.4)
    raise SystemExit(f"{address} does not answer")


if __name__ == "__main__":
    with sync_playwright() as tool:
        chromium = tool.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        report(chromium, Path(sys.argv[1]))
        app(chromium, Path(sys.argv[1]))
        chromium.close()
