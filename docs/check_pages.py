"""Open every page of the built site in headless Chromium: ``python docs/check_pages.py FOLDER [PICTURES]``.

No link may lead to a page, or a place on one, that is not there, or have a scheme that no browser knows. At 400 and
1280 pixels no page may log an error, miss a picture, ask for anything beyond the folder, or be wider than the window.
Without a Chromium only the links are checked. With PICTURES, photographs of some pages are written there. Chromium is
spoken to through a pipe (the DevTools protocol), so that nothing listens.
"""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

WIDTHS = (400, 1280)
PHOTOGRAPHED = (
    "index.html",
    "tutorials/why.html",
    "reference/commands.html",
    "reference/api-estimators.html",
    "reference/effects/backlash.html",
    "paper.html",
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: Pictures that did not load, and by how many pixels the page is wider than the window; a telephone's innerWidth grows
#: with the page.
LOOK = """JSON.stringify({
  broken: [...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src),
  wider: document.documentElement.scrollWidth - document.documentElement.clientWidth})"""


class Anchors(HTMLParser):
    """The names of places on a page, and the addresses that it links to."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what a tag names and links to."""
        own = dict(attrs)
        self.names.add(own.get("id") or "")
        if tag == "a" and own.get("href"):
            self.links.append(own["href"] or "")


def dead_links(folder: Path) -> list[str]:
    """The links that lead nowhere, page by page; addresses on the web are not looked at."""
    pages = {page: Anchors(page) for page in sorted(folder.rglob("*.html")) if "_static" not in page.parts}
    found = []
    for page, anchors in pages.items():
        for link in dict.fromkeys(anchors.links):
            to = urlsplit(link)
            if to.scheme in ("http", "https", "mailto"):
                continue
            target = (page.parent / unquote(to.path)).resolve() if to.path else page
            there = not to.scheme and target.exists()
            if not there or (to.fragment and target in pages and unquote(to.fragment) not in pages[target].names):
                found.append(f"{page.relative_to(folder)}: {link} leads nowhere")
    return found


class Browser:
    """A headless Chromium at the other end of two pipes."""

    def __init__(self, program: str, profile: str) -> None:
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()

        def wire() -> None:
            # Above 4 first: either end may lie on the numbers that Chromium reads and writes.
            source, sink = os.dup2(to_read, 103), os.dup2(to_write, 104)
            os.dup2(source, 3)
            os.dup2(sink, 4)

        self._process = subprocess.Popen(
            [
                program,
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--remote-debugging-pipe",
                f"--user-data-dir={profile}",
            ],
            pass_fds=(3, 4),
            preexec_fn=wire,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(to_write)
        self._numbers = itertools.count(1)
        self._rest = b""
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = ""
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._read, 1 << 16)
            if not part:
                raise SystemExit("Chromium ended")
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        document = json.loads(message)
        assert isinstance(document, dict)
        return document

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Ask, and wait for the answer; events on the way are kept."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if getattr(self, "_session", ""):
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                if "error" in answer:
                    raise SystemExit(f"{method}: {answer['error']}")
                result = answer["result"]
                assert isinstance(result, dict)
                return result
            self.events.append(answer)

    def open(self, url: str, width: int) -> None:
        """Show a page, and wait until it is loaded."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 500
        )
        self.events.clear()
        self.call("Page.navigate", url=url)
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._receive())

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()


def faults(browser: Browser, folder: Path, page: Path, width: int) -> list[str]:
    """What is wrong with a page at a width."""
    browser.open(page.as_uri(), width)
    look = json.loads(browser.call("Runtime.evaluate", expression=LOOK, returnByValue=True)["result"]["value"])
    found = [f"picture missing: {source}" for source in look["broken"]]
    if look["wider"] > 0:
        found.append(f"{look['wider']} pixels wider than the window")
    for event in browser.events:
        parameters = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                found.append(f"exception: {parameters['exceptionDetails'].get('text')}")
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "assert"):
                found.append(f"console: {parameters['args']}")
            case "Log.entryAdded" if parameters["entry"]["level"] == "error":
                found.append(f"log: {parameters['entry']['text']} {parameters['entry'].get('url', '')}")
            case "Network.requestWillBeSent":
                url = parameters["request"]["url"]
                if not url.startswith((folder.as_uri(), "data:", "about:")):
                    found.append(f"asks for {url}")
    return [f"{page.relative_to(folder)} at {width}: {fault}" for fault in found]


def main(folder: Path, pictures: Path | None) -> int:
    """Check every page; 1 where something is wrong. Without a browser, its links alone."""
    found = dead_links(folder)
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        print(*found, f"no Chromium here: the pages were not opened; {len(found)} dead links", sep="\n")
        return 1 if found else 0
    pages = [page for page in sorted(folder.rglob("*.html")) if not {"_modules", "_static"} & set(page.parts)]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:  # Chromium's children outlive it a little
        browser = Browser(program, profile)
        for page, width in itertools.product(pages, WIDTHS):
            found += faults(browser, folder, page, width)
            if pictures is not None and str(page.relative_to(folder)) in PHOTOGRAPHED:
                pictures.mkdir(parents=True, exist_ok=True)
                image = base64.b64decode(browser.call("Page.captureScreenshot", format="png")["data"])
                (pictures / f"{page.stem}-{width}.png").write_bytes(image)
        browser.close()
    print(*found, f"{len(pages)} pages at {' and '.join(map(str, WIDTHS))} pixels, {len(found)} faults", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else None))
