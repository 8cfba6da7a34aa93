"""What a browser makes of the built pages: widths, what is cut off, how much is loaded.

`python docs/_tools/browser.py [page …]` prints a line for every page and width that has something to
complain of; the tests use `measured`. Pages are shown in frames of the widths of a desk and of a
telephone, and everything comes from this machine.
"""

from __future__ import annotations

import gzip
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any

BUILT = Path(__file__).resolve().parents[1] / "_build" / "html"
WIDTHS = (1400, 420)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
TEXT = (".html", ".js", ".css", ".svg")  # which hosts send packed
PATIENCE = 900  # seconds for all pages
HARNESS = """<!doctype html><meta charset="utf-8"><body><script>
const pages = PAGES, widths = WIDTHS, rest = ms => new Promise(done => setTimeout(done, ms));
const cut = (doc, width) => [...doc.querySelectorAll("pre, table, img, p, li, h1, h2, h3, .math, figure")]
  .filter(x => x.getBoundingClientRect().width > 0 && !x.closest(".sidebar-drawer, .toc-drawer, details:not([open])"))
  .filter(x => {
    const style = doc.defaultView.getComputedStyle(x), own = x.scrollWidth > x.clientWidth + 1;
    const scrolls = /auto|scroll/.test(style.overflowX);
    if (x.tagName === "PRE") return own && !(scrolls && x.closest(".columns"));
    let box = x.getBoundingClientRect(), holder = x.parentElement;
    while (holder && !/auto|scroll/.test(doc.defaultView.getComputedStyle(holder).overflowX)) holder = holder.parentElement;
    return !holder && box.right > width + 1;
  }).map(x => x.tagName + ": " + (x.textContent || x.alt || "").trim().slice(0, 60));
async function look(page, width) {
  const frame = document.createElement("iframe");
  frame.style = `width:${width}px;height:1600px;border:0`;
  const loaded = new Promise(done => frame.onload = done);
  frame.src = "/" + page; document.body.append(frame);
  await loaded;
  const win = frame.contentWindow, doc = frame.contentDocument;
  if (doc.querySelector("script[src*=mathjax]"))
    for (let k = 0; k < 60 && !(win.MathJax && win.MathJax.startup && win.MathJax.startup.promise); k++) await rest(50);
  if (win.MathJax && win.MathJax.startup) await win.MathJax.startup.promise;
  await rest(page.includes("search.html") ? 2500 : 150);
  const root = doc.documentElement, entries = win.performance.getEntriesByType("resource");
  const main = win.performance.getEntriesByType("navigation");
  const films = entries.filter(x => /film|[.]gif$/.test(x.name)), rest_ = entries.filter(x => !/[.]gif$/.test(x.name));
  const size = list => list.reduce((sum, x) => sum + x.encodedBodySize, 0);
  const broken = [...doc.images].filter(x => x.complete && !x.naturalWidth).map(x => x.src);
  const row = {page, width, scroll: root.scrollWidth, client: root.clientWidth, cut: cut(doc, root.clientWidth),
    bytes: size(main) + size(rest_), films: size(films), broken,
    outside: entries.map(x => x.name).filter(x => !x.startsWith(location.origin)),
    formulas: doc.querySelectorAll("mjx-container").length, raw: doc.querySelectorAll("mjx-merror").length,
    found: doc.querySelectorAll("#search-results ul.search li").length};
  frame.remove();
  return row;
}
(async () => {
  for (const width of widths) for (const page of pages) {
    let row;
    try { row = await look(page, width); } catch (error) { row = {page, width, error: String(error)}; }
    await fetch("/report", {method: "POST", body: JSON.stringify(row)});
  }
  await fetch("/report", {method: "POST", body: "null"});
})();
</script>"""


@dataclass(frozen=True)
class Looked:
    """A page at a width, as the browser measured it."""

    page: str
    width: int
    numbers: dict[str, Any]

    @property
    def complaints(self) -> list[str]:
        """What is cut off, broken or fetched from elsewhere."""
        x = self.numbers
        if "error" in x:
            return [x["error"]]
        wide = x["scroll"] > x["client"]
        return [
            *([f"{x['scroll']} pixels in {x['client']}"] if wide else []),
            *(f"cut off: {text}" for text in x["cut"]),
            *(f"broken: {name}" for name in x["broken"]),
            *(f"from outside: {name}" for name in x["outside"]),
            *([f"{x['raw']} formulas that are none"] if x["raw"] else []),
        ]


def browser() -> str | None:
    """The command of a browser that needs no screen, if there is one."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def pages(folder: Path = BUILT) -> list[str]:
    """All pages but those of the source code."""
    every = (path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*.html")))
    return [page for page in every if not page.startswith(("_modules", "_static"))]


def measured(names: list[str], folder: Path = BUILT) -> list[Looked]:
    """Every page at every width."""
    rows: Queue = Queue()
    harness = HARNESS.replace("PAGES", json.dumps(names)).replace("WIDTHS", json.dumps(WIDTHS))
    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), partial(Handler, rows, harness.encode(), directory=str(folder))
    )
    # pages are left while films still come
    server.handle_error = lambda *_: None  # type: ignore[method-assign]
    Thread(target=server.serve_forever, daemon=True).start()
    command = browser()
    assert command is not None
    found = []
    with tempfile.TemporaryDirectory() as profile:
        address = f"http://127.0.0.1:{server.server_port}/harness"
        options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}"]
        process = subprocess.Popen(
            [command, *options, "--window-size=1500,1700", "--remote-debugging-port=0", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            while (row := rows.get(timeout=PATIENCE)) is not None:
                found.append(Looked(row.pop("page"), row.pop("width"), row))
        finally:
            process.terminate()
            process.wait(timeout=30)
            server.shutdown()
            server.server_close()
    return found


class Handler(SimpleHTTPRequestHandler):
    """Serves the pages as a host does, text packed, and takes the reports."""

    def __init__(self, rows: Queue, harness: bytes, *args: Any, **options: Any) -> None:
        self.rows, self.harness = rows, harness
        super().__init__(*args, **options)

    def do_POST(self) -> None:
        text = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        self.rows.put(json.loads(text))

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if self.path == "/harness":
            self._send(self.harness, "text/html")
        elif path.suffix in TEXT and path.is_file():
            self._send(path.read_bytes(), self.guess_type(str(path)))
        else:
            super().do_GET()

    def _send(self, data: bytes, kind: str) -> None:
        packed = gzip.compress(data, 6, mtime=0)
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(packed)))
        self.send_header("Cache-Control", "no-store")  # every page pays for all that it loads
        self.end_headers()
        self.wfile.write(packed)

    def end_headers(self) -> None:
        if not self.headers.get("Content-Length"):
            self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing."""


if __name__ == "__main__":
    looked = measured(sys.argv[1:] or pages())
    for row in looked:
        for complaint in row.complaints:
            print(f"{row.page} at {row.width}: {complaint}")
    heaviest = sorted(looked, key=lambda row: -row.numbers.get("bytes", 0))[:5]
    print(
        f"{len(looked)} looks at {len({row.page for row in looked})} pages; heaviest before films:"
    )
    for row in heaviest:
        print(f"  {row.page}: {row.numbers['bytes'] / 1e3:.0f} kB at {row.width}")
