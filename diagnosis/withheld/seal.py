"""Sealing: what was done is put away, and its fingerprint published before anybody looks."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from diagnosis.withheld import case
from diagnosis.withheld.case import Case
from diagnosis.withheld.errors import refusal

TRUTH = "truth.json"
SEAL = "truth.sha256"


def seal(cases: Sequence[Case], hidden: Path, public: Path) -> str:
    """Put the truth into one folder and its fingerprint into another.

    Args:
        cases: The cases drawn.
        hidden: Folder that the diagnosis cannot read; made where there is none.
        public: Folder for the SHA-256; made where there is none.

    Returns:
        The SHA-256 in hexadecimal digits.

    Raises:
        WithheldError: if both are one folder, or a truth or seal lies there already.
    """
    if hidden.resolve() == public.resolve():
        raise refusal("hidden and public", "must be two folders", hidden, "Part them.")
    for path in (hidden / TRUTH, public / SEAL):
        if os.path.lexists(path):
            raise refusal("seal", "must not be broken", path, "Give new folders.")
    text = case.dumps(cases).encode()
    digest = hashlib.sha256(text).hexdigest()
    hidden.mkdir(parents=True, exist_ok=True)
    public.mkdir(parents=True, exist_ok=True)
    _write(hidden / TRUTH, text)
    _write(public / SEAL, f"{digest}  {TRUTH}\n".encode())
    return digest


def verify(hidden: Path, public: Path) -> tuple[Case, ...]:
    """Open the truth after making sure that it is the one that was sealed.

    Raises:
        WithheldError: if either file is missing, or the truth is not what was sealed.
    """
    try:
        text = (hidden / TRUTH).read_bytes()
        digest = (public / SEAL).read_text(encoding="ascii").split()[0]
    except (OSError, UnicodeDecodeError, IndexError) as error:
        raise refusal("seal", "must have a truth and a fingerprint", hidden, f"{error}.") from error
    if hashlib.sha256(text).hexdigest() != digest:
        raise refusal("truth", "must be the one sealed", hidden / TRUTH, "It was changed since.")
    return case.loads(text.decode())


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)
