"""The index of a data set: a Parquet table with one row per frame."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.patterns import errors

FILE = "index.parquet"


def encode(rows: Iterable[dict[str, Any]]) -> bytes:
    """Encode rows, sorted by frame number, as the bytes of a Parquet file.

    Raises:
        InputError: if pyarrow is not installed.
    """
    pa, parquet = _pyarrow()
    columns = {
        "frame": pa.int64(),
        "view": pa.int64(),
        "scene": pa.int64(),
        "repeat": pa.int32(),
        "name": pa.string(),
        "room": pa.string(),
        "sensor": pa.string(),
        "seed": pa.int64(),
        "ndp_rate": pa.float64(),
        "mean_dn": pa.float64(),
        "exposure_s": pa.float64(),
        "gain": pa.float64(),
        "shard": pa.string(),
        "files": pa.list_(pa.string()),
        "bytes": pa.int64(),
        "sha256": pa.string(),
    }
    ordered = sorted(rows, key=lambda row: row["frame"])
    table = pa.table(
        {name: pa.array([row[name] for row in ordered], kind) for name, kind in columns.items()}
    )
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def read(path: Path) -> list[dict[str, Any]]:
    """Read the rows of a data set.

    Args:
        path: the set's folder.

    Raises:
        InputError: if it has no index, the index is damaged, or pyarrow is not installed.
    """
    pa, parquet = _pyarrow()
    file = path / FILE
    if not file.is_file():
        advice = "Is it a finished set of starling generate?"
        raise errors.refuse("set", f"must have an {FILE}", path, advice)
    try:
        return parquet.read_table(file).to_pylist()
    except (OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0]
        raise errors.refuse(FILE, "must be a Parquet file", file, f"{reason}.") from error


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
