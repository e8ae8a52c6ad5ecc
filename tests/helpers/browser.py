"""Pages as a browser lays them out: what is wider than its column, measured by Chromium without a display."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

#: Flags of a browser that shows one local file and talks to nobody.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
#: Appended to a copy of the page: what is wider than the room that it has, with its beginning and both widths.
MEASURE = """
<script>
const found = [];
for (const e of document.querySelectorAll("table, pre, img, p, li, nav, h1, h2, h3")) {
  const room = e.parentElement.getBoundingClientRect().width, width = Math.max(e.scrollWidth, e.offsetWidth);
  if (width > room + 1 || e.scrollWidth > e.clientWidth + 1)
    found.push([e.tagName + ": " + e.textContent.trim().replace(/\\s+/g, " ").slice(0, 80), width, room]);
}
const root = document.documentElement;
if (root.scrollWidth > root.clientWidth) found.push(["the page", root.scrollWidth, root.clientWidth]);
const shown = document.createElement("pre");
shown.id = "measured";
shown.textContent = JSON.stringify({tables: document.querySelectorAll("table").length, found});
document.body.replaceChildren(shown);
</script>
"""


def chromium() -> str:
    """The browser; a test that needs it is skipped where there is none, which is a failure where CI is set."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("Chromium is missing: apt-get install chromium")
    return found


def too_wide(page: str, width: int = 1200) -> list[str]:
    """Tables, text and pictures of a page that are wider than their column in a window of so many pixels.

    Parameters
    ----------
    page
        The HTML, with at least one table.
    width
        Of the window.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        path.write_text(page.replace("</body>", f"{MEASURE}</body>"), encoding="utf-8")
        done = subprocess.run(
            [chromium(), *FLAGS, f"--user-data-dir={folder}/profile", f"--window-size={width},1000",
             "--virtual-time-budget=10000", "--dump-dom", path.as_uri()],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
    shown = re.search(r'<pre id="measured">(.*?)</pre>', done.stdout, re.DOTALL)
    assert shown is not None, done.stdout[:500] + done.stderr
    measured = json.loads(html.unescape(shown[1]))
    assert measured["tables"] > 0
    return [f"{what} is {wide:.0f} px wide in {room:.0f} px" for what, wide, room in measured["found"]]
