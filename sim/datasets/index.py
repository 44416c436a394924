"""The index of a data set: a Parquet table with one row per frame."""

from __future__ import annotations

import dataclasses
import io
import typing
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.console import output
from starling.sim.sensor import structure

FILE = "index.parquet"
_NULLABLE = ("exposure_s", "gain")  # A structured-light sensor has neither.


@dataclass(frozen=True, kw_only=True, slots=True)
class IndexRow:
    """Columns of the index."""

    frame: int
    view: int
    scene: int
    repeat: int
    name: str  # VIEW/REPEAT
    room: str
    sensor: str
    seed: int
    ndp_rate: float  # Share of pixels without depth.
    mean_dn: float  # Mean of the left infrared image [DN].
    exposure_s: float | None = None
    gain: float | None = None
    shard: str  # Archive that holds the frame; empty for folders.
    files: tuple[str, ...]  # Files of this frame, by path in the set.
    bytes: int
    sha256: str  # See `render_view.fingerprint`.

    def __post_init__(self) -> None:
        for name in ("frame", "view", "scene", "seed", "bytes"):
            errors.whole_number(name, getattr(self, name), 0, 2**63 - 1)
        errors.whole_number("repeat", self.repeat, 0, 2**31 - 1)


def check_row(row: Any, file: Path) -> dict[str, Any]:
    """Check a row from a file, and return it with whole numbers as floats where they are expected.

    Raises:
        InputError: if a key is missing or unknown, a value has another type, or a file's name leads
            out of the set.
    """
    known = {key: value for key, value in row.items() if value is not None} if row else row
    checked = dataclasses.asdict(structure.from_table(IndexRow, known))
    _check_names(checked, file)
    return checked


def encode(rows: Iterable[dict[str, Any]]) -> bytes:
    """Encode rows, sorted by frame number, as the bytes of a Parquet file.

    Raises:
        InputError: if pyarrow is not installed.
    """
    pa, parquet = _pyarrow()
    ordered = sorted(rows, key=lambda row: row["frame"])
    table = pa.table(
        {name: pa.array([row[name] for row in ordered], kind) for name, kind in _columns(pa)}
    )
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _columns(pa: Any) -> list[tuple[str, Any]]:
    """List the names and types of the columns, in the order of the row's fields."""
    kinds = {
        int: pa.int64(),
        float: pa.float64(),
        float | None: pa.float64(),
        str: pa.string(),
        tuple[str, ...]: pa.list_(pa.string()),
    }
    hints = typing.get_type_hints(IndexRow)
    return [(name, pa.int32() if name == "repeat" else kinds[hints[name]]) for name in hints]


def read(path: Path) -> list[dict[str, Any]]:
    """Read the rows of a data set.

    Args:
        path: the set's folder.

    Raises:
        InputError: if it has no index, or pyarrow is not installed. Also if the index is damaged,
            lacks a column, or names a file outside the set.
    """
    pa, parquet = _pyarrow()
    file = path / FILE
    if not file.is_file():
        advice = "Is it a finished set of starling generate?"
        raise errors.refuse("set", f"must have an {FILE}", path, advice)
    try:
        table = parquet.read_table(file)
        rows = table.to_pylist()
    except Exception as error:  # A damaged file raises errors of many types.
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise errors.refuse(FILE, "must be a Parquet file", file, f"{reason}.") from None
    for name, kind in _columns(pa):
        if name not in table.column_names:
            raise errors.refuse(FILE, f"must have the column {name}", file, "Generate it again.")
        column = table.column(name)
        if column.type != kind or (column.null_count and name not in _NULLABLE):
            rule = f"must have a column {name} of {kind} without gaps"
            raise errors.refuse(FILE, rule, f"{column.type} in {file}", "Generate it again.")
    for row in rows:
        _check_names(row, file)
    return rows


def _check_names(row: Mapping[str, Any], file: Path) -> None:
    """Refuse names of files that could lie outside the set."""
    names = [row["name"], *row["files"], *([row["shard"]] if row["shard"] else [])]
    for name in names:
        if not isinstance(name, str) or not output.is_inside(name):
            rule = "must name files in the set"
            raise errors.refuse(FILE, rule, f"{name!r} in {file}", "Is it damaged?")


def count_frames(rows: Sequence[Mapping[str, Any]], wanted: int) -> tuple[int, int, int]:
    """Return the numbers of present, missing and duplicate frames.

    Args:
        rows: rows of the index.
        wanted: expected number of frames.
    """
    counts = Counter(row["frame"] for row in rows)
    return len(counts), wanted - len(counts), len(rows) - len(counts)


def refuse_without() -> None:
    """Check that an index can be written, before any work is done.

    Raises:
        InputError: if pyarrow is not installed.
    """
    _pyarrow()


def _pyarrow() -> Any:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise errors.needs("index", "pyarrow", "data") from error
    return pyarrow, parquet
