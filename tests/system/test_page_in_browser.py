"""The report in a real browser: nothing is wider than a desk's or a telephone's window."""

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
ASKS = """<iframe id="page" style="width:{width}px;height:{height}px;border:0" srcdoc="{page}">
</iframe><script>
onload = () => {{
  const shown = document.getElementById("page").contentDocument;
  const broken = [...shown.images].filter((one) => !one.naturalWidth).length;
  document.title = [shown.documentElement.scrollWidth, shown.images.length, broken].join(" ");
}};
</script>"""


@pytest.mark.parametrize("width", [1280, 390])
def test_no_page_has_to_be_moved_sideways(width: int, tmp_path: Path) -> None:
    """A browser's window has a least width, a frame in it has none."""
    place = tmp_path / "asks.html"
    shown = escape(page(FULL))
    place.write_text(ASKS.format(width=width, height=HEIGHT, page=shown), encoding="utf-8")
    size = f"--window-size={max(width, 800)},{HEIGHT}"
    home = f"--user-data-dir={tmp_path / 'home'}"
    asked = ["--headless", "--no-sandbox", "--disable-gpu", size, home, "--dump-dom"]
    ran = subprocess.run(
        [str(BROWSER), *asked, place.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    told = re.search(r"<title>(\d+) (\d+) (\d+)</title>", ran.stdout)
    assert told is not None, ran.stderr
    widest, pictures, broken = map(int, told.groups())
    assert widest <= width
    assert pictures > 5 and not broken
