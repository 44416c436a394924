"""Sealing: what was done is put away, and its fingerprint published before anybody looks.

Beside it that of the diagnosis' families, which must not be drawn anew once answers are known.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path

from diagnosis.withheld import case
from diagnosis.withheld.case import Case
from diagnosis.withheld.errors import refusal

TRUTH = "truth.json"
FAMILIES = "families.json"
SEAL = "truth.sha256"


def seal(cases: Sequence[Case], told: bytes, hidden: Path, public: Path) -> str:
    """Put the truth into one folder, and its fingerprint and the families into another.

    Args:
        cases: The cases drawn.
        told: Families, as `FAMILIES` is to hold them.
        hidden: Folder that the diagnosis cannot read; made where there is none.
        public: Folder for the SHA-256; made where there is none.

    Returns:
        The SHA-256 of the truth in hexadecimal digits.

    Raises:
        WithheldError: if both are one folder, or a truth or seal lies there already.
    """
    if hidden.resolve() == public.resolve():
        raise refusal("hidden and public", "must be two folders", hidden, "Part them.")
    for path in (hidden / TRUTH, public / FAMILIES, public / SEAL):
        if os.path.lexists(path):
            raise refusal("seal", "must not be broken", path, "Give new folders.")
    text = case.dumps(cases).encode()
    digest = _digest(text)
    hidden.mkdir(parents=True, exist_ok=True)
    public.mkdir(parents=True, exist_ok=True)
    _write(hidden / TRUTH, text)
    _write(public / FAMILIES, told)
    _write(public / SEAL, f"{digest}  {TRUTH}\n{_digest(told)}  {FAMILIES}\n".encode())
    return digest


def verify(told: bytes, hidden: Path, public: Path) -> tuple[Case, ...]:
    """Open the truth after making sure that it and the families are those that were sealed.

    Args:
        told: Families that the diagnosis has now.
        hidden: Folder of the truth.
        public: Folder of the seal.

    Raises:
        WithheldError: if truth or seal is missing, or either is not what was sealed.
    """
    try:
        text = (hidden / TRUTH).read_bytes()
        of_truth, of_families = (public / SEAL).read_text(encoding="ascii").split()[::2]
    except (OSError, ValueError) as error:
        raise refusal("seal", "must have a truth and a fingerprint", hidden, f"{error}.") from error
    if _digest(text) != of_truth:
        raise refusal("truth", "must be the one sealed", hidden / TRUTH, "It was changed since.")
    if _digest(told) != of_families:
        rule, advice = "must be those sealed", "The diagnosis' table was changed since."
        raise refusal("families", rule, public / FAMILIES, advice)
    return case.loads(text.decode())


def families(content: bytes) -> dict[str, str]:
    """Family by effect, of what `FAMILIES` holds.

    Raises:
        WithheldError: if it is no table of effects.
    """
    try:
        return {name: str(told["family"]) for name, told in json.loads(content).items()}
    except (ValueError, AttributeError, TypeError, KeyError) as error:
        rule, advice = "must be a table of effects", "The diagnosis writes it."
        raise refusal("families", rule, type(error).__name__, advice) from error


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)
