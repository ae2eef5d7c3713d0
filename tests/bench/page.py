"""Frames a second of the light mixer while a slider is dragged: python -m tests.bench.page.

In Debian's Chromium, without a graphics card: drawn as the page does there, by the processor, and
as it would with a card, by WebGL, which is software here and slower than any card. The preview has
2 MP and two or three lamps. Where the machine is too slow for every pixel of the window the page
draws fewer while something is dragged; both numbers are told, and the processor's time that the
page took for a frame, which other programs on the machine do not change much.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from typing import Any

import httpx
from playwright.sync_api import CDPSession, Page, sync_playwright

from tests.chromium import find_chromium

_WINDOWS = ((1440, 900), (1920, 1080), (2560, 1440))
_SECONDS = 4
_COUNT = """() => {
  window.drawn = 0;
  const kinds = { drawArrays: WebGL2RenderingContext, putImageData: CanvasRenderingContext2D };
  for (const [name, kind] of Object.entries(kinds)) {
    const draw = kind.prototype[name];
    kind.prototype[name] = function (...given) {
      window.drawn++;
      return draw.apply(this, given);
    };
  }
}"""
_GRAPHICS = """() => {
  const ask = WebGL2RenderingContext.prototype.getExtension;
  WebGL2RenderingContext.prototype.getExtension = function (name) {
    return name === "WEBGL_debug_renderer_info" ? null : ask.call(this, name);
  };
}"""
_DRAG = """async (seconds) => {
  const slider = document.querySelector(".strip input[type=range]");
  const canvas = document.querySelector("#mix");
  const begin = performance.now();
  const first = window.drawn;
  for (let step = 0; performance.now() - begin < 1000 * seconds; step++) {
    slider.value = 3 * Math.sin(step / 20);
    slider.dispatchEvent(new Event("input"));
    await new Promise(requestAnimationFrame);
  }
  const whole = Math.round(canvas.clientWidth * canvas.clientHeight * devicePixelRatio ** 2);
  const drawn = canvas.width * canvas.height;
  return [window.drawn - first, performance.now() - begin, whole, drawn];
}"""


def main() -> int:
    """Make a job for each number of lamps, drag, print a row for each window."""
    program = find_chromium()
    if program is None:
        raise SystemExit("Install Debian's package chromium.")
    with tempfile.TemporaryDirectory() as folder:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        url = f"http://127.0.0.1:{port}"
        settings = {"LIGHTLAYERS_DATA_DIR": folder, "LIGHTLAYERS_PORT": str(port)}
        service = subprocess.Popen(
            [sys.executable, "-m", "service.cli", "serve"],
            env=os.environ | settings,
            stderr=subprocess.DEVNULL,
        )
        try:
            _measure(url, program)
        finally:
            service.terminate()
            service.wait()
    return 0


def _measure(url: str, program: str) -> None:
    _say("| drawn by | lamps | window | canvas, MP | drawn, MP | frames a second | ms for each |")
    _say("|---|---|---|---|---|---|---|")
    with sync_playwright() as playwright, httpx.Client(base_url=url) as http:
        jobs = {lamps: _job(http, lamps) for lamps in (2, 3)}
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        for painter in ("processor", "WebGL by software"):
            for lamps, job in jobs.items():
                for width, height in _WINDOWS:
                    page = browser.new_page(viewport={"width": width, "height": height})
                    page.add_init_script(f"({_COUNT})()")
                    if painter != "processor":
                        page.add_init_script(f"({_GRAPHICS})()")
                    measured = _drag(page, f"{url}/#/jobs/{job}")
                    page.close()
                    _say(row(painter, lamps, (width, height), *measured))
        browser.close()


def row(
    painter: str,
    lamps: int,
    window: tuple[int, int],
    pixels: tuple[int, int],
    frames: int,
    seconds: tuple[float, float],
) -> str:
    """Write a row; pixels: in all and while dragged; seconds: by the clock and of the processor."""
    whole, drawn = (f"{count / 1e6:.2f}" for count in pixels)
    took, spent = seconds
    rate, cost_ms = f"{frames / took:.0f}", f"{1000 * spent / frames:.0f}"
    parts = (painter, lamps, f"{window[0]} × {window[1]}", whole, drawn, rate, cost_ms)
    return f"| {' | '.join(map(str, parts))} |"


def _say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


def _job(http: httpx.Client, lamps: int) -> str:
    """Id of a finished job whose preview has 2 MP."""
    while True:
        try:
            http.get("/readyz").raise_for_status()
            break
        except httpx.HTTPError:
            time.sleep(0.2)
    body: dict[str, Any] = {
        "capture": {"camera": f"sim://studio?lights={lamps}&width=1728&height=1152"},
        "options": {"lights": lamps, "quality": "fast", "outputs": ["layers.exr", "preview.exr"]},
    }
    job = http.post("/jobs", json=body).raise_for_status().json()
    while job["state"] in ("queued", "running"):
        time.sleep(0.5)
        job = http.get(job["links"]["self"]).raise_for_status().json()
    if job["state"] != "succeeded":
        raise SystemExit(json.dumps(job["error"]))
    found: str = job["id"]
    return found


def _drag(page: Page, address: str) -> tuple[tuple[int, int], int, tuple[float, float]]:
    """Drag for a while; pixels, frames and seconds as row() takes them."""
    page.goto(address)
    page.wait_for_selector("#mix[aria-busy=false]", timeout=120_000)
    page.evaluate(_DRAG, _SECONDS)  # until the page knows the machine
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    before = _processor_seconds(session)
    frames, took_ms, whole, drawn = page.evaluate(_DRAG, _SECONDS)
    return (whole, drawn), frames, (took_ms / 1000, _processor_seconds(session) - before)


def _processor_seconds(session: CDPSession) -> float:
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "ProcessTime"))


if __name__ == "__main__":
    sys.exit(main())
