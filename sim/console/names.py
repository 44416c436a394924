"""Names in data as file names: one component, inside its folder, different for different names."""

from __future__ import annotations

import hashlib
import unicodedata
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

_PLAIN = frozenset("-_.,+=@~ ()[]")  # Characters that stay, besides letters and digits.
_LONGEST = 120  # Bytes of an escaped name; file systems allow 255, and suffixes are added.
_FILES = {"capture.toml", "sensor.toml", "starling.json"}  # Beside the scenes of a set.
_DIGITS = 16  # Hexadecimal digits of the hash that ends a shortened name.


def file_name(name: str) -> str:
    """Turn a name from data into one component of a path.

    Letters, digits and usual punctuation stay. All other characters become `%` and the hexadecimal
    digits of their UTF-8 bytes, as in a URL. So does a dot or space at an end. Long names are
    shortened, and end in a hash. Different names give different file names.

    Args:
        name: any text, for example the room of a capture.

    Example:
        >>> file_name("kitchen 2")
        'kitchen 2'
        >>> file_name("../../etc")
        '%2E.%2F..%2Fetc'
    """
    plain = "".join(character if _stays(character) else _escaped(character) for character in name)
    if plain[:1] in (".", " "):
        plain = _escaped(plain[0]) + plain[1:]
    if plain[-1:] in (".", " "):
        plain = plain[:-1] + _escaped(plain[-1])
    if not plain:
        return "%"
    if len(plain.encode()) <= _LONGEST:
        return plain
    short = plain.encode()[: _LONGEST - _DIGITS - 1].decode(errors="ignore")
    return f"{short}%{_digest(name)}"


def scene_folder(name: str) -> str:
    """Turn a scene's name into the name of its folder, which no other file of a set has.

    Example:
        >>> scene_folder(".hidden"), scene_folder("capture.toml")
        ('%2Ehidden', 'capture%2Etoml')
    """
    folder = file_name(name)
    return folder.replace(".", "%2E") if folder in _FILES else folder


def distinct_names(paths: Iterable[Path]) -> dict[Path, str]:
    """Name each path by its stem, and by as many folders before it as make the names differ.

    Example:
        >>> distinct_names([Path("a/mesh.ply"), Path("b/mesh.ply"), Path("b/cup.ply")]).values()
        dict_values(['a-mesh', 'b-mesh', 'cup'])
    """
    known = sorted(set(paths))
    names = {path: path.stem for path in known}
    for depth in range(2, max((len(path.parts) for path in known), default=0) + 1):
        counts = Counter(names.values())
        for path in known:
            if counts[names[path]] > 1:
                names[path] = "-".join((*path.parts[-depth:-1], path.stem)).lstrip("/-")
    counts = Counter(names.values())
    return {
        path: name if counts[name] == 1 else f"{name}-{_digest(str(path))[:6]}"
        for path, name in names.items()
    }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:_DIGITS]


def _stays(character: str) -> bool:
    if character in _PLAIN:
        return True
    return character.isalnum() and unicodedata.is_normalized("NFC", character)


def _escaped(character: str) -> str:
    return "".join(f"%{byte:02X}" for byte in character.encode(errors="surrogatepass"))
