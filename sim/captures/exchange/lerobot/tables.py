"""Parquet files of a LeRobot data set.

The schemas hold what other programs need: `datasets` the types of images, `pandas` the index.

Source: LeRobot 0.6.1, `datasets/io_utils.py`, `datasets/dataset_writer.py`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

from starling.patterns.errors import needs

CHUNK_FILES = 1000
FILE_MB = 100
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_GROUP_ROWS = 32  # Frames that are held in memory until they are written.
_BYTES_PER_MB = 2**20


def refuse_missing_library() -> None:
    """Refuse to go on without pyarrow.

    Raises:
        InputError: if `pyarrow` is not installed.
    """
    try:
        import_module("pyarrow.parquet")
    except ImportError as error:
        raise needs("lerobot", "pyarrow", "lerobot") from error


class DataFiles:
    """Files of frames; a new one begins with the first episode after `FILE_MB`."""

    def __init__(self, folder: Path, features: Mapping[str, Mapping[str, Any]]) -> None:
        self._folder = folder
        self._schema = _frame_schema(features)
        self._index = 0
        self._writer: Any = None
        self._rows: list[dict[str, Any]] = []

    def __enter__(self) -> DataFiles:
        """Return the files."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write the rest, unless there is an error, and close the last file."""
        self._close(flush=error is None)

    def start_episode(self) -> dict[str, int]:
        """Return the place of the next episode."""
        self._flush()
        if self._writer is not None and self._path().stat().st_size >= FILE_MB * _BYTES_PER_MB:
            self._close()
            self._index += 1
        return self._place()

    def write(self, row: dict[str, Any]) -> None:
        """Write a frame; image features are bytes."""
        self._rows.append(row)
        if len(self._rows) >= _GROUP_ROWS:
            self._flush()

    def _place(self) -> dict[str, int]:
        chunk, file = divmod(self._index, CHUNK_FILES)
        return {"chunk_index": chunk, "file_index": file}

    def _path(self) -> Path:
        return self._folder / PLACE.format(**self._place())

    def _flush(self) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        if not self._rows:
            return
        if self._writer is None:
            self._path().parent.mkdir(parents=True, exist_ok=True)
            self._writer = parquet.ParquetWriter(self._path(), self._schema)
        self._writer.write_table(pa.Table.from_pylist(self._rows, schema=self._schema))
        self._rows = []

    def _close(self, *, flush: bool = True) -> None:
        if flush:
            self._flush()
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def _frame_schema(features: Mapping[str, Mapping[str, Any]]) -> Any:
    """Return columns of a feature each, with the types that the library `datasets` reads."""
    import pyarrow as pa

    image = pa.struct({"bytes": pa.binary(), "path": pa.string()})
    columns, kinds = [], {}
    for name, feature in features.items():
        if feature["dtype"] == "image":
            columns.append(pa.field(name, image))
            kinds[name] = {"_type": "Image"}
        else:
            columns.append(pa.field(name, feature["dtype"].replace("float64", "double")))
            kinds[name] = {"dtype": feature["dtype"], "_type": "Value"}
    described = json.dumps({"info": {"features": kinds}})
    return pa.schema(columns, metadata={"huggingface": described})


def write_episodes(path: Path, episodes: Sequence[dict[str, Any]]) -> None:
    """Write a row for each episode."""
    import pyarrow as pa
    from pyarrow import parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.Table.from_pylist(list(episodes)), path)


def write_tasks(path: Path, tasks: Sequence[str]) -> None:
    """Write the index of each task; the task itself is the index of `pandas`."""
    import pyarrow as pa
    from pyarrow import parquet

    text = {"pandas_type": "unicode", "numpy_type": "object"}
    number = {"pandas_type": "int64", "numpy_type": "int64"}
    described = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "field_name": None, **text, "metadata": None}],
        "columns": [
            {"name": name, "field_name": name, **kind, "metadata": None}
            for name, kind in (("task_index", number), ("task", text))
        ],
        "pandas_version": "2.0.0",
    }
    columns = [pa.field("task_index", pa.int64()), pa.field("task", pa.string())]
    schema = pa.schema(columns, metadata={"pandas": json.dumps(described)})
    rows = {"task_index": list(range(len(tasks))), "task": list(tasks)}
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.Table.from_pydict(rows, schema=schema), path)
