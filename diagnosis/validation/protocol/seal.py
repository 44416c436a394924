"""Sealing: what was done is put away, and its fingerprint published before anybody looks.

Beside it those of the diagnosis' families, of what was asked for and of the code, none of which may
become another once answers are known.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol import case
from starling.diagnosis.validation.protocol.case import Case

TRUTH = "truth.json"
FAMILIES = "families.json"
ASKED = "asked.json"
CODE = "code"
SEAL = "truth.sha256"
WORKED = "worked"  # Fingerprints of the code after each run of programs.
MADE = "made.json"  # Of what and by which code a source's folder is made.

_ROOT = Path(__file__).parents[3]
_PACKAGES = ("calibration", "diagnosis", "learning", "patterns", "sim")
_SUFFIXES = (".py", ".json", ".toml")
_PICTURE = re.compile(r'"([^"\n]+\.png)"')


def seal(cases: Sequence[Case], told: Mapping[str, bytes], hidden: Path, public: Path) -> str:
    """Put the truth into one folder, and its fingerprint and what else is told into another.

    The fingerprint comes last: without it nothing is sealed, and nothing can have been answered.

    Args:
        cases: The cases drawn.
        told: Content of `FAMILIES` and `ASKED`.
        hidden: Folder that the diagnosis is not told of; made where there is none.
        public: Folder for the SHA-256; made where there is none.

    Returns:
        The SHA-256 of the truth in hexadecimal digits.

    Raises:
        WithheldError: if both are one folder, or a seal lies there already.
    """
    if hidden.resolve() == public.resolve():
        raise refusal("hidden and public", "must be two folders", hidden, "Part them.")
    if (public / SEAL).exists():
        raise refusal("seal", "must not be broken", public / SEAL, "Give new folders.")
    text = case.dumps(cases).encode()
    prints = {TRUTH: digest(text), **{name: digest(one) for name, one in told.items()}}
    prints[CODE] = code()
    hidden.mkdir(parents=True, exist_ok=True)
    public.mkdir(parents=True, exist_ok=True)
    _write(hidden / TRUTH, text)
    for name, content in told.items():
        _write(public / name, content)
    lines = [f"{value}  {name}\n" for name, value in prints.items()]
    _write(public / SEAL, "".join(lines).encode())
    return prints[TRUTH]


def verify(told: Mapping[str, bytes], hidden: Path, public: Path) -> tuple[Case, ...]:
    """Open the truth after making sure that it and all that is told are those that were sealed.

    Args:
        told: What `FAMILIES` and `ASKED` would hold now.
        hidden: Folder of the truth.
        public: Folder of the seal.

    Raises:
        WithheldError: if truth or seal is missing, or anything is not what was sealed.
    """
    sealed = _sealed(public)
    try:
        text = (hidden / TRUTH).read_bytes()
    except OSError as error:
        raise refusal("seal", "must have a truth", hidden, f"{error}.") from error
    if digest(text) != sealed.get(TRUTH):
        raise refusal(
            "truth", "must be the one sealed", hidden / TRUTH, "Put it back, or give a new folder."
        )
    for name, content in told.items():
        if digest(content) != sealed.get(name):
            rule = f"must be what {public / name} has"
            advice = "Ask the same of this folder, with the same table, or give another."
            raise refusal(name, rule, _start(content), advice)
    return case.loads(text.decode())


def is_of_this_code(public: Path) -> bool:
    """Whether what runs now, and what ran before, is what was sealed.

    Raises:
        WithheldError: if there is no seal.
    """
    path = public / WORKED
    ran = path.read_text(encoding="ascii").split() if path.exists() else []
    return {code(), *ran} == {_sealed(public).get(CODE)}


def worked(public: Path) -> None:
    """Note the code after programs ran: one that was changed meanwhile leaves verdicts."""
    with (public / WORKED).open("a", encoding="ascii") as file:
        file.write(f"{code()}\n")


def made(folder: Path, of: Mapping[str, Any], *, there: bool) -> None:
    """Note of what a folder's content is made, and by which code, before it is.

    Args:
        folder: Made where there is none.
        of: What can be written as JSON.
        there: Whether the content is made already.

    Raises:
        WithheldError: if it was made of something else, or by another code.
    """
    told = json.dumps({**of, CODE: code()}, indent=1).encode()
    path = folder / MADE
    if there and (not path.exists() or path.read_bytes() != told):
        rule = f"must be made of what {path} has"
        raise refusal("folder", rule, _start(told), "Ask the same of it, or give another.")
    folder.mkdir(parents=True, exist_ok=True)
    _write(path, told)


def code() -> str:
    """SHA-256 of all that is this project's and that cases, verdicts and scores follow from.

    Interpreter and libraries are not in it (`versions`), nor Blender, which its light tells.
    """
    found = hashlib.sha256()
    for package in _PACKAGES:
        paths = (path for path in (_ROOT / package).rglob("*") if path.suffix in _SUFFIXES)
        for path in sorted(paths):
            found.update(f"{path.relative_to(_ROOT)}\n".encode())
            found.update(path.read_bytes())
    return found.hexdigest()


def versions() -> dict[str, str]:
    """Versions of Python and of this package's libraries; verdicts tell the diagnosis' own."""
    libraries = {one.__name__: one.__version__ for one in (cv2, np, scipy)}
    return {"python": sys.version.split()[0], **libraries}


def _sealed(public: Path) -> dict[str, str]:
    """Fingerprints by what they are of."""
    try:
        lines = (public / SEAL).read_text(encoding="ascii").splitlines()
        return {name: value for value, name in (line.split("  ") for line in lines)}
    except (OSError, ValueError) as error:
        raise refusal("seal", "must have fingerprints", public / SEAL, f"{error}.") from error


def _start(content: bytes) -> str:
    text = " ".join(content.decode().split())
    return text if len(text) < 300 else f"{text[:300]} ..."


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


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def content(path: Path) -> str:
    """SHA-256 of a file or of all files of a folder; of what is neither, a preset, the name."""
    if path.is_file():
        return digest(path.read_bytes())
    files = sorted(one for one in path.rglob("*") if one.is_file())
    each = [f"{digest(one.read_bytes())}  {one.relative_to(path)}\n" for one in files]
    return digest("".join(each).encode()) if files else path.name


def of_sensor(believed: Path) -> str:
    """SHA-256 of a sensor file and the pictures of patterns that it names; of a preset the name."""
    if not believed.is_file():
        return content(believed)
    text = believed.read_bytes()
    named = sorted(set(_PICTURE.findall(text.decode())))
    pictures = [content(believed.parent / name) for name in named]
    return digest(" ".join([digest(text), *pictures]).encode())


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)
