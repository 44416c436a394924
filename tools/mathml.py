"""Hook of MkDocs: replaces the LaTeX formulas of a built page by MathML, which browsers render."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def on_page_content(text: str, **_: Any) -> str:
    """Convert every formula that `pymdownx.arithmatex` marked."""
    text = _INLINE.sub(lambda formula: convert(html.unescape(formula[1])), text)
    return _DISPLAY.sub(lambda formula: convert(html.unescape(formula[1]), display="block"), text)
