"""`plumb monitor --web` in a real browser: what the page shows, and that it asks nobody else."""

from __future__ import annotations

import json
import pathlib
import re
import shutil
import subprocess
import threading
import time
from typing import Iterator

import pytest
from master import PLUMB, Master, Plumb, until

webdriver = pytest.importorskip("selenium.webdriver")

INSTALL = "sudo apt-get install -y chromium chromium-driver"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PHONE = (390, 844)
DESK = (1280, 1000)


class Monitor:
    """A running `plumb monitor --web`."""

    def __init__(self, *arguments: str, at: str = "127.0.0.1:0") -> None:
        command = [PLUMB, "monitor", "--plain", "--web", at, *arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.url = self.process.stdout.readline().rsplit(" ", 1)[-1].strip()
        # Somebody has to read the lines.
        threading.Thread(target=self.process.stdout.read, daemon=True).start()

    def stop(self) -> None:
        """Ends the program."""
        self.process.kill()
        self.process.wait()


@pytest.fixture
def browser() -> Iterator[webdriver.Chrome]:
    binary = next(filter(None, map(shutil.which, BROWSERS)), None)
    driver = shutil.which("chromedriver")
    if binary is None or driver is None:
        pytest.skip(f"no browser to look with; type {INSTALL}")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for flag in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(flag)
    options.add_argument(f"--window-size={DESK[0]},{DESK[1]}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=driver)
    chrome = webdriver.Chrome(options=options, service=service)
    yield chrome
    chrome.quit()


@pytest.fixture
def plumb() -> Iterator[Plumb]:
    with Plumb() as plumb:
        yield plumb


@pytest.fixture
def monitor(plumb: Plumb) -> Iterator[Monitor]:
    monitor = Monitor("--bus", f"127.0.0.1:{plumb.port}", "-b", "250000", "--start")
    yield monitor
    monitor.stop()


def text(browser: webdriver.Chrome, selector: str) -> str:
    """The text of an element, read at once while the page goes on changing."""
    return browser.execute_script(
        "return document.querySelector(arguments[0]).innerText", selector
    )


def angles(browser: webdriver.Chrome, channel: int) -> list[str]:
    """Slope X and Y of a channel as the page shows them."""
    script = "return [...document.querySelectorAll(arguments[0])].map((e) => e.innerText)"
    return browser.execute_script(script, f"#channel{channel} .angle b")


def shows(browser: webdriver.Chrome, selector: str, wanted: str, seconds: float = 15) -> None:
    """Waits until an element has this text."""
    until(lambda: wanted in text(browser, selector), f"{wanted!r} in {selector}", seconds)


def requests(browser: webdriver.Chrome) -> list[str]:
    """Everything that the browser has asked for."""
    messages = (json.loads(entry["message"])["message"] for entry in browser.get_log("performance"))
    sent = (m for m in messages if m["method"] == "Network.requestWillBeSent")
    return [m["params"]["request"]["url"] for m in sent]


def complaints(browser: webdriver.Chrome) -> list[str]:
    """What the browser's console has, but for the connection that a test has cut."""
    entries = (entry["message"] for entry in browser.get_log("browser"))
    return [entry for entry in entries if "net::ERR_" not in entry]


def picture(browser: webdriver.Chrome, folder: pathlib.Path, name: str) -> pathlib.Path:
    """A picture of the page, for who wants to see it."""
    path = folder / f"{name}.png"
    browser.save_screenshot(str(path))
    return path


def is_as_sent(browser: webdriver.Chrome, master: Master, channel: int) -> bool:
    """Whether what is shown was sent, to the last digit, and is where the housing stands."""
    mark = len(master.frames)
    time.sleep(0.6)
    shown = angles(browser, channel)
    time.sleep(0.1)
    sent = [f.data for f in master.frames[mark:] if f.arbitration_id == 0x181 + channel]
    for axis, truth in ((0, 12.0), (1, -7.0)):
        raw = {int.from_bytes(d[2 * axis : 2 * axis + 2], "little", signed=True) for d in sent}
        if shown[axis] not in {f"{count / 100:+.3f}" for count in raw}:
            return False
        if float(shown[axis]) != pytest.approx(truth, abs=0.3):
            return False
    return True


def test_both_angles_are_those_of_the_bus_and_nobody_else_is_asked(
    browser: webdriver.Chrome, plumb: Plumb, monitor: Monitor, tmp_path: pathlib.Path
) -> None:
    browser.get(monitor.url)
    shows(browser, "#verdict", "ok: both agree")
    plumb.turn(-7, 12)
    master = Master(plumb)
    time.sleep(1.5)
    for channel in (0, 1):
        # A busy machine may show later what was sent before.
        until(lambda: is_as_sent(browser, master, channel), f"channel {channel} as it was sent")
    assert "inside its band" in text(browser, "#pair")
    assert re.search(r"\d+\.\d % of 250 kbit/s", text(browser, "#bus"))
    assert "degC" in text(browser, "#channel1")
    for _ in range(2):
        browser.find_element("css selector", "[data-axis='1']").click()
        browser.find_element("css selector", "[data-span='600']").click()
    ink = "const c = document.getElementById('housing'); return c.getContext('2d')" \
        ".getImageData(0, 0, c.width, c.height).data.some((v) => v !== 0)"
    until(lambda: browser.execute_script(ink), "the housing")
    plots = "return document.querySelectorAll('.uplot canvas').length"
    until(lambda: browser.execute_script(plots) == 2, "two plots")
    picture(browser, tmp_path, "agree")
    browser.set_window_size(*PHONE)
    wide = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    until(lambda: browser.execute_script(wide) <= 0, "a page that is no wider than a phone")
    picture(browser, tmp_path, "phone")
    assert complaints(browser) == []
    asked = requests(browser)
    assert any(url.endswith("/events") for url in asked)
    assert all(url.startswith((monitor.url, "data:")) for url in asked), asked


def test_a_fault_appears_by_name_and_the_angle_goes(
    browser: webdriver.Chrome, plumb: Plumb, monitor: Monitor, tmp_path: pathlib.Path
) -> None:
    browser.get(monitor.url)
    shows(browser, "#verdict", "ok: both agree")
    plumb.type("fault b bias x 20 mg")
    shows(browser, "#channel1", "the channels differ for too long")
    plumb.type("roll 15")
    shows(browser, "#verdict", "FAULT: channel B is faulty")
    assert "moved alone, or gravity of the wrong length" in text(browser, "#verdict")
    shows(browser, "#events", "EMCY FF08h: this channel moved alone, or its gravity is of the wrong length")
    assert angles(browser, 1)[0] == "--"
    # The reason comes with the next exchange of the nodes (TPDO 3), one SYNC behind the state.
    shows(browser, "#channel1 .angle", "gravity of the wrong length")
    picture(browser, tmp_path, "fault")
    assert complaints(browser) == []


def test_when_nothing_comes_the_page_states_it_and_shows_no_number(
    browser: webdriver.Chrome, plumb: Plumb, monitor: Monitor, tmp_path: pathlib.Path
) -> None:
    browser.get(monitor.url)
    shows(browser, "#verdict", "ok: both agree")
    assert text(browser, "#link") == "live"
    plumb.stop()
    shows(browser, "#link", "no connection to plumb monitor")
    assert angles(browser, 0) == ["--", "--"]
    assert "valid" not in text(browser, "#channel0 dl").replace("validity", "")
    assert "not known" in text(browser, "#verdict")
    assert monitor.process.wait(60) == 2
    picture(browser, tmp_path, "gone")
    assert complaints(browser) == []


def test_a_page_finds_its_program_again(
    browser: webdriver.Chrome, plumb: Plumb, monitor: Monitor
) -> None:
    browser.get(monitor.url)
    shows(browser, "#verdict", "ok: both agree")
    monitor.stop()
    shows(browser, "#link", "no connection to plumb monitor")
    port = monitor.url.rstrip("/").rsplit(":", 1)[-1]
    again = Monitor("--bus", f"127.0.0.1:{plumb.port}", at=f"127.0.0.1:{port}")
    try:
        shows(browser, "#link", "live", 30)
        shows(browser, "#verdict", "ok: both agree")
    finally:
        again.stop()
