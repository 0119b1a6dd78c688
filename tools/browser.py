"""Headless Chromium for tests of the page, controlled by the DevTools protocol through a pipe.

The protocol needs no package: JSON texts that end with a zero byte, on two open files (``--remote-debugging-pipe``). Everything
that a browser would ask of a network by itself is switched off, and it draws by software, so that tests say the same anywhere.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from base64 import b64decode
from pathlib import Path
from types import TracebackType
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
# what an iPhone of 390 x 844 points, a small notebook and a usual desktop show
SIZES = {"desktop": (1280, 800), "phone": (390, 844), "wide": (1440, 900)}
PATIENCE = 120.0  # seconds for an answer: drawn by software, maybe on a busy machine


def find_browser() -> str | None:
    """The browser: FLEXMAPS_BROWSER, or the first of ``NAMES`` that is there."""
    asked = os.environ.get("FLEXMAPS_BROWSER")
    return asked or next(filter(None, map(shutil.which, NAMES)), None)


def obstacle() -> str | None:
    """Return the reason why no browser is available, as a sentence; ``None`` if one is. Installs Debian's on the first call, as root."""
    if sys.platform != "linux":
        return "the browser for the page is only tried on Linux"
    if find_browser() is not None:
        return None
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        return f"no browser: install one of {', '.join(NAMES[:3])}, or name it in FLEXMAPS_BROWSER"
    print("Installing Chromium (once, about a minute)", file=sys.stderr, flush=True)
    for command in (
        ["apt-get", "update", "-q"],
        ["apt-get", "install", "-q", "-y", "--no-install-recommends", "chromium"],
    ):
        if subprocess.run(command, capture_output=True).returncode:
            return f"no browser: '{' '.join(command)}' failed"
    return None


class Browser:
    """One page in a browser of its own, with a fresh folder for what it keeps.

    messages : what the page wrote on its console, and errors that nobody caught; requests : addresses that it asked for
    """

    def __init__(self, size: str = "desktop", *, dark: bool = False, still: bool = True, options: tuple[str, ...] = ()):
        self.size, self.messages, self.requests = size, list[str](), list[str]()
        self._number, self._rest, self._loaded = 0, b"", False
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        (there, self._out), (self._in, back) = os.pipe(), os.pipe()
        program = find_browser()
        assert program is not None
        # the browser reads from file 3 and writes to file 4
        shell = f'exec "$0" "$@" 3<&{there} 4>&{back}'
        words = [
            program,
            *OPTIONS,
            *options,
            "--remote-debugging-pipe",
            f"--user-data-dir={self._folder.name}",
            "about:blank",
        ]
        self._process = subprocess.Popen(
            ["bash", "-c", shell, *words], pass_fds=(there, back), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(there)
        os.close(back)
        self._session: str | None = None
        targets = self.call("Target.getTargets")["targetInfos"]
        target = next(one["targetId"] for one in targets if one["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        width, height = SIZES[size]
        phone = size == "phone"
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)
        features = [
            ("prefers-color-scheme", "dark" if dark else "light"),
            ("prefers-reduced-motion", "reduce" if still else ""),
        ]
        self.call("Emulation.setEmulatedMedia", features=[{"name": name, "value": value} for name, value in features])

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the browser."""
        try:
            self._session = None
            self.call("Browser.close")
            self._process.wait(10)
        except (OSError, TimeoutError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._out)
        os.close(self._in)
        self._folder.cleanup()

    # -- the protocol ----------------------------------------------------------------------------------------------------

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Send a command of the DevTools protocol and record the events until its answer."""
        self._number += 1
        sent: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            sent["sessionId"] = self._session
        os.write(self._out, json.dumps(sent).encode() + b"\0")
        while True:
            told = self._next()
            if told.get("id") == self._number:
                if "error" in told:
                    raise RuntimeError(f"{method}: {told['error']['message']}")
                answer: dict[str, Any] = told["result"]
                return answer

    def _next(self) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(until - time.monotonic(), 0.0))
            data = os.read(self._in, 1 << 20) if ready else b""
            if not data:
                raise TimeoutError("the browser does not answer")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\0")
        told: dict[str, Any] = json.loads(line)
        self._note(told.get("method", ""), told.get("params", {}))
        return told

    def _note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Runtime.consoleAPICalled":
            self.messages.append(" ".join(str(one.get("value", one.get("description"))) for one in params["args"]))
        elif method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.messages.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded":
            self.messages.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Page.loadEventFired":
            self._loaded = True

    # -- what a person does ----------------------------------------------------------------------------------------------

    def open(self, path: Path, address: str = "", ready: str = "document.readyState == 'complete'") -> None:
        """Open a file, with ``address`` after its own (#...), and wait until an expression holds. What was noted is forgotten."""
        for url in (
            "about:blank",
            path.resolve().as_uri() + address,
        ):  # from the page itself, another address would not load it anew
            self._loaded = False
            self.messages.clear()
            self.requests.clear()
            self.call("Page.navigate", url=url)
            while not self._loaded:
                self._next()
        self.wait(ready)

    def wait(self, ready: str) -> None:
        """Wait until an expression holds."""
        until = time.monotonic() + PATIENCE
        while not self.evaluate(f"!!({ready})"):
            if time.monotonic() > until:
                raise TimeoutError(f"never: {ready}; {self.messages}")
            time.sleep(0.05)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in told:
            raise RuntimeError(told["exceptionDetails"].get("exception", {}).get("description", "an error in the page"))
        return told["result"].get("value")

    def settle(self) -> None:
        """Wait until what was asked to be drawn is drawn."""
        self.evaluate(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 50))))"
        )

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element, in the window."""
        box = self.evaluate(f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
                            "return [b.x + b.width / 2, b.y + b.height / 2]; })()")  # fmt: skip
        return float(box[0]), float(box[1])

    def click(self, selector: str) -> None:
        """Press an element with the pointer."""
        x, y = self.middle(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        self.settle()

    def drag(self, selector: str, x: float, y: float) -> None:
        """Press the pointer on an element and move it by (x, y) pixels."""
        a, b = self.middle(selector)
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=a, y=b, button="left", clickCount=1)
        for share in (0.5, 1.0):
            self.call(
                "Input.dispatchMouseEvent",
                type="mouseMoved",
                x=a + share * x,
                y=b + share * y,
                button="left",
                buttons=1,
            )
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=a + x, y=b + y, button="left", clickCount=1)
        self.settle()

    def touch(self, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Put fingers on the screen and move each from one place to another."""

        def points(share: float) -> list[dict[str, float]]:
            return [
                {"x": a[0] + share * (b[0] - a[0]), "y": a[1] + share * (b[1] - a[1]), "id": k}
                for k, (a, b) in enumerate(ways)
            ]

        self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=points(0.0))
        for share in (0.25, 0.5, 0.75, 1.0):
            self.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=points(share))
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()

    def key(self, name: str, text: str = "") -> None:
        """Press a key."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=name, code=name, text=text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=name, code=name)
        self.settle()

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Take a PNG picture of the window or of the whole page."""
        self.settle()
        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b64decode(data))

    def processor(self) -> dict[str, float]:
        """Seconds of the processor that each kind of the browser's processes has taken so far: "renderer" runs the page, "GPU" draws."""
        session, self._session = self._session, None  # the browser's own to tell
        told = self.call("SystemInfo.getProcessInfo")["processInfo"]
        self._session = session
        found: dict[str, float] = {}
        for one in told:
            found[one["type"]] = found.get(one["type"], 0.0) + float(one["cpuTime"])
        return found
