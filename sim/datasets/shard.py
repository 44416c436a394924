"""Some views as one tar archive, in WebDataset's layout, and back to folders.

A frame is a sample: all files of one name before the first dot, `0000012/0.ir_left.png`. What a
view's frames share, as `truth.png`, stands in each of them. Equal views give equal bytes.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath

from starling.sim.datasets.render_view import Taken


def name(number: int) -> str:
    """File of a shard."""
    return f"shard-{number:06d}.tar"


def packed(views: Sequence[Taken]) -> bytes:
    """Put views into one archive, frame by frame."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for view in views:
            for member, data in _samples(view):
                entry = tarfile.TarInfo(member)
                entry.size, entry.mode = len(data), 0o644
                archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def _samples(view: Taken) -> Iterator[tuple[str, bytes]]:
    """Files of each frame under its sample's name."""
    shared = {
        path.name: data
        for path, data in ((PurePosixPath(n), d) for n, d in view.files.items())
        if len(path.parts) == 2
    }
    for repeat in range(len(view.rows)):
        own = f"{view.name}/{repeat}/"
        files = {n.removeprefix(own): d for n, d in view.files.items() if n.startswith(own)}
        for file, data in sorted({**shared, **files}.items()):
            yield f"{view.name}/{repeat}.{file}", data


def unpacked(archive: bytes) -> dict[str, bytes]:
    """Files of a shard by path in a capture set.

    Args:
        archive: what `packed` gave.
    """
    found: dict[str, bytes] = {}
    with tarfile.open(fileobj=io.BytesIO(archive), mode="r") as read:
        for member in read:
            file = read.extractfile(member)
            assert file is not None  # There is nothing but files in it.
            found |= _placed(member.name, file.read())
    return found


def _placed(member: str, data: bytes) -> Mapping[str, bytes]:
    view, _, rest = member.partition("/")
    repeat, _, file = rest.partition(".")
    where = view if file in SHARED else f"{view}/{repeat}"
    return {f"{where}/{file}": data}


SHARED = frozenset({"camera.toml", "label.png", "room", "scene.toml", "truth.png"})
