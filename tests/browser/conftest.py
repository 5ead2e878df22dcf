"""A short log with a hidden effect, its report, the app on it, and a browser; skipped where no browser is."""

import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from pycosim.cli import demo
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.report.folder import Folder

ROOT = Path(__file__).parents[2]
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
APP_LOG = "app.log"
# no sandbox: CI runs as root; the others keep the browser from looking for servers of its own
QUIET = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync"]


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: .[test] brings it")
    if BROWSER is None:
        pytest.skip("no browser: install chromium")
    with playwright.sync_playwright() as tool:
        opened = tool.chromium.launch(executable_path=BROWSER, headless=True, args=QUIET)
        yield opened
        opened.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Beside what failed, what the page said then: a wait that ends in vain does not tell why."""
    report = yield
    shown = getattr(item, "funcargs", {}).get("page")
    if call.when == "call" and report.failed and shown is not None and not shown.is_closed():
        with suppress(Exception):  # a page that does not answer must not hide what failed
            report.sections.append(("What the page said", shown.locator("body").inner_text()))
    log = getattr(item, "funcargs", {}).get("tmp_path", Path()) / APP_LOG
    if call.when == "call" and report.failed and log.is_file():
        report.sections.append(("What the app said", log.read_text()))
    return report


@pytest.fixture
def page(browser):
    """A page; the test fails when it logs an error, or asks anyone but this machine."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light", accept_downloads=True)
    opened = context.new_page()
    wrong = []
    opened.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    opened.on("pageerror", lambda e: wrong.append(str(e)))
    opened.on("request", lambda r: None if r.url.startswith(("file:", "data:", "blob:", "http://127.0.0.1:"))
              else wrong.append(f"asked {r.url}"))
    yield opened
    context.close()
    assert not wrong


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    """A study whose log hides a Stribeck term at 2A."""
    folder = tmp_path_factory.mktemp("browser") / "hidden"
    with Folder(folder, "demo") as made:
        demo._make(Library(), made, speeds=(0.4, 1.6), longest=2.0)
    return folder / "study.toml"


@pytest.fixture(scope="session")
def report(study):
    """The report of that study."""
    out = study.parent.parent / "report"
    assert main(["report", str(study), "--out", str(out), "--quiet"]) == 0
    return out / "report.html"


@pytest.fixture
def app(study, tmp_path):
    """Start the app; returns a function of its arguments that gives the address, and the app's folder."""
    started = []

    def start(*arguments):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        command = [sys.executable, "-m", "pycosim.cli", "app", *map(str, arguments), "--no-browser", "--quiet",
                   "--port", str(port), "--out", str(tmp_path / "app")]
        # NiceGUI takes a server that pytest started for one of its own tests
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
        with (tmp_path / APP_LOG).open("a") as log:
            started.append(subprocess.Popen(command, cwd=tmp_path, env={**environment, "PYTHONPATH": str(ROOT)},
                                            stdout=log, stderr=subprocess.STDOUT, text=True))
        address, until = f"http://127.0.0.1:{port}", time.monotonic() + 120
        while time.monotonic() < until:
            try:
                urlopen(address, timeout=10).close()
                return address, tmp_path / "app"
            except (URLError, OSError):
                if started[-1].poll() is not None:
                    raise AssertionError((tmp_path / APP_LOG).read_text()) from None
                time.sleep(0.3)
        raise AssertionError("the app does not answer")
    yield start
    for process in started:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()  # an open page can hold the server
            process.wait(30)
