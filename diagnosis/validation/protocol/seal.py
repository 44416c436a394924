"""Seal of the truth: its digest is published before any case is diagnosed.

The seal also holds the digests of the effect families of the diagnosis, of the request and of the
code. None of them may change after verdicts exist.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy

from starling.diagnosis.validation.camera import json_file
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol import case, files
from starling.diagnosis.validation.protocol.case import Case

TRUTH = "truth.json"
FAMILIES = "families.json"
REQUEST = "asked.json"
CODE = "code"
SEAL = "truth.sha256"
CODE_LOG = "worked"  # Digests of the code after each run of the programs.
INPUTS = "made.json"  # Inputs and code digest of the folder of a capture source.

_ROOT = Path(str(resources.files("starling")))
_PACKAGES = ("calibration", "diagnosis", "learning", "patterns", "sim")
_SUFFIXES = (".py", ".json", ".toml")
_PICTURE = re.compile(r'"([^"\n]+\.png)"')


def seal(
    cases: Sequence[Case], public_files: Mapping[str, bytes], hidden: Path, public: Path
) -> str:
    """Write the truth to a hidden folder, and its digest and the public files to another.

    The digests are written last. Without them there is no seal, and no case has been diagnosed.

    Args:
        cases: The drawn cases.
        public_files: Content of `FAMILIES` and `REQUEST`.
        hidden: Folder that the diagnosis does not read; created if missing.
        public: Folder of the digests; created if missing.

    Returns:
        The SHA-256 of the truth in hexadecimal digits.

    Raises:
        WithheldError: if a seal exists.
    """
    if (public / SEAL).exists():
        raise refusal("seal", "must not be broken", public / SEAL, "Give new folders.")
    contents = {TRUTH: case.dumps(cases).encode(), **public_files}
    digests = {**{name: digest(text) for name, text in contents.items()}, CODE: code_digest()}
    for name, text in contents.items():
        folder = hidden if name == TRUTH else public
        folder.mkdir(parents=True, exist_ok=True)
        files.write(folder / name, text)
    lines = [f"{value}  {name}\n" for name, value in digests.items()]
    files.write(public / SEAL, "".join(lines).encode())
    return digests[TRUTH]


def verify(public_files: Mapping[str, bytes], hidden: Path, public: Path) -> tuple[Case, ...]:
    """Read the truth after verifying it and the public files against the seal.

    Args:
        public_files: Current content of `FAMILIES` and `REQUEST`.
        hidden: Folder of the truth.
        public: Folder of the seal.

    Returns:
        The sealed cases.

    Raises:
        WithheldError: if truth or seal is missing, or a digest differs from the seal.
    """
    sealed = _sealed(public)
    try:
        text = (hidden / TRUTH).read_bytes()
    except OSError as error:
        raise refusal("seal", "must have a truth", hidden, f"{error}.") from error
    if digest(text) != sealed.get(TRUTH):
        advice = "Put it back, or give a new folder."
        raise refusal("truth", "must be the one sealed", hidden / TRUTH, advice)
    for name, content in public_files.items():
        if digest(content) != sealed.get(name):
            rule = f"must be what {public / name} has"
            advice = "Use the same options and effect table as before, or give a new folder."
            raise refusal(name, rule, _start(content), advice)
    return case.loads(text.decode())


def code_is_sealed(public: Path) -> bool:
    """Return whether the current code, and the code of all earlier runs, is the sealed code.

    Raises:
        WithheldError: if there is no seal.
    """
    path = public / CODE_LOG
    logged = path.read_text(encoding="ascii").split() if path.exists() else []
    return {code_digest(), *logged} == {_sealed(public).get(CODE)}


def log_code(public: Path) -> None:
    """Append the current code digest to the log, as verdicts of changed code may now exist."""
    with (public / CODE_LOG).open("a", encoding="ascii") as file:
        file.write(f"{code_digest()}\n")


def record_inputs(folder: Path, inputs: Mapping[str, Any], *, exists: bool) -> None:
    """Record the inputs and the code digest of a folder's content before it is made.

    Args:
        folder: Folder of the content; created if missing.
        inputs: Inputs as JSON values.
        exists: Whether the content exists. An existing record is compared first.

    Raises:
        WithheldError: if existing content has other inputs or is of other code.
    """
    content = json.dumps({**inputs, CODE: code_digest()}, indent=1).encode()
    path = folder / INPUTS
    if exists and (not path.exists() or path.read_bytes() != content):
        rule = f"must be made of what {path} has"
        advice = "Use the same options and code as before, or give a new folder."
        raise refusal("folder", rule, _start(content), advice)
    folder.mkdir(parents=True, exist_ok=True)
    files.write(path, content)


def code_digest() -> str:
    """Return the SHA-256 of the project's code, on which cases, verdicts and scores depend.

    It excludes the interpreter and the libraries (see `versions`), and Blender, whose version is
    recorded with its light.
    """
    sha = hashlib.sha256()
    packages = (path for name in _PACKAGES for path in (_ROOT / name).rglob("*"))
    for path in sorted(path for path in (*_ROOT.glob("*"), *packages) if path.suffix in _SUFFIXES):
        sha.update(f"{path.relative_to(_ROOT)}\n".encode())
        sha.update(path.read_bytes())
    return sha.hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of Python and of this package's libraries."""
    libraries = {library.__name__: library.__version__ for library in (cv2, np, scipy)}
    return {"python": sys.version.split()[0], **libraries}


def _sealed(public: Path) -> dict[str, str]:
    """Read the digests of the seal by file name."""
    try:
        lines = (public / SEAL).read_text(encoding="ascii").splitlines()
        return {name: value for value, name in (line.split("  ") for line in lines)}
    except (OSError, ValueError) as error:
        raise refusal("seal", "must have digests", public / SEAL, f"{error}.") from error


def _start(content: bytes) -> str:
    text = " ".join(content.decode().split())
    return text if len(text) < 300 else f"{text[:300]} ..."


def parse_families(content: bytes) -> dict[str, str]:
    """Parse the content of `FAMILIES`: family by effect.

    Raises:
        WithheldError: if the content is no JSON, or an effect has no family.
    """
    table = json_file.parse(content, FAMILIES, "the text")
    entries = table if isinstance(table, dict) else {"": table}
    for name, entry in entries.items():
        if not isinstance(entry, dict) or not isinstance(entry.get("family"), str):
            rule = "must have a family by effect"
            raise refusal(FAMILIES, rule, f"{entry!r} for {name!r}", "Put the sealed file back.")
    return {name: entry["family"] for name, entry in entries.items()}


def digest(content: bytes) -> str:
    """Return the SHA-256 in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def path_digest(path: Path) -> str:
    """Return the SHA-256 of a file or of all files of a folder, or the name if neither exists."""
    if path.is_file():
        return digest(path.read_bytes())
    inside = sorted(file for file in path.rglob("*") if file.is_file())
    lines = [f"{digest(file.read_bytes())}  {file.relative_to(path)}\n" for file in inside]
    return digest("".join(lines).encode()) if lines else path.name


def sensor_digest(sensor: Path) -> str:
    """Return the SHA-256 of a sensor file and its pattern images, or the name of a preset."""
    if not sensor.is_file():
        return path_digest(sensor)
    text = sensor.read_bytes()
    names = sorted(set(_PICTURE.findall(text.decode())))
    pictures = [path_digest(sensor.parent / name) for name in names]
    return digest(" ".join([digest(text), *pictures]).encode())
