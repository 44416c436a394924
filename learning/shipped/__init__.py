"""Models that come with the program. README.md describes their training data."""

from __future__ import annotations

from pathlib import Path

NAMES = ("hybrid-varied", "network-varied")
COMPLETION = Path(__file__).parent / "completion"  # Weights of the compact completion network.


def folder(model: Path) -> Path:
    """Return the folder of a shipped model by name; other paths are returned unchanged."""
    return Path(__file__).parent / model if str(model) in NAMES else model
