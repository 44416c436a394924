"""All file formats of the fuzz tests, by the name of their test."""

from __future__ import annotations

from tests.system import fuzzed_captures, fuzzed_models, fuzzed_sets

FORMATS = {**fuzzed_captures.FORMATS, **fuzzed_sets.FORMATS, **fuzzed_models.FORMATS}
