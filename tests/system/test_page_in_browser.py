"""The report in a real browser: it fits the window of a desktop and of a phone."""

from __future__ import annotations

import re
import shutil
import subprocess
from html import escape
from pathlib import Path

import pytest

from starling.diagnosis.report.page import page
from tests.unit.diagnosis.made_diagnosis import FULL

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium (apt-get install chromium)")

HEIGHT = 800
FRAME = """<iframe id="page" style="width:{width}px;height:{height}px;border:0" srcdoc="{page}">
</iframe><script>
onload = () => {{
  const shown = document.getElementById("page").contentDocument;
  const broken = [...shown.images].filter((image) => !image.naturalWidth).length;
  document.title = [shown.documentElement.scrollWidth, shown.images.length, broken].join(" ");
}};
</script>"""


@pytest.mark.parametrize("width", [1280, 390])
def test_page_needs_no_horizontal_scrolling(width: int, tmp_path: Path) -> None:
    """An iframe sets the width, because a browser window has a minimum width."""
    place = tmp_path / "frame.html"
    text = escape(page(FULL))
    place.write_text(FRAME.format(width=width, height=HEIGHT, page=text), encoding="utf-8")
    size = f"--window-size={max(width, 800)},{HEIGHT}"
    home = f"--user-data-dir={tmp_path / 'home'}"
    flags = ["--headless", "--no-sandbox", "--disable-gpu", size, home, "--dump-dom"]
    finished = subprocess.run(
        [str(BROWSER), *flags, place.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    title = re.search(r"<title>(\d+) (\d+) (\d+)</title>", finished.stdout)
    assert title is not None, finished.stderr
    widest, pictures, broken = map(int, title.groups())
    assert widest <= width
    assert pictures > 5 and not broken
