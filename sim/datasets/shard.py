"""Tar archives of views in the WebDataset layout, and their conversion back to folders.

A frame is a sample: files that share the name before the first dot, `0000012/0.ir_left.png`. Files
that the frames of a view share, such as `truth.png`, are repeated in each sample. Equal views give
equal bytes.
"""

from __future__ import annotations

import io
import re
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from starling.patterns.errors import InputError, refuse
from starling.sim.datasets.render_view import RenderedView

_MEMBER = re.compile(r"[^/.]+/[0-9]+\.[^/]+")  # VIEW/REPEAT.FILE


def name(number: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{number:06d}.tar"


def pack(views: Sequence[RenderedView]) -> bytes:
    """Pack views into one archive, frame by frame."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for view in views:
            for member, data in _samples(view):
                entry = tarfile.TarInfo(member)
                entry.size, entry.mode = len(data), 0o644
                archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def _samples(view: RenderedView) -> Iterator[tuple[str, bytes]]:
    """Yield the files of each frame under the name of its sample."""
    shared = {
        path.name: data
        for path, data in ((PurePosixPath(n), d) for n, d in view.files.items())
        if len(path.parts) == 2
    }
    for repeat in range(len(view.rows)):
        prefix = f"{view.name}/{repeat}/"
        files = {n.removeprefix(prefix): d for n, d in view.files.items() if n.startswith(prefix)}
        for file, data in sorted({**shared, **files}.items()):
            yield f"{view.name}/{repeat}.{file}", data


def unpack(archive: bytes, name: str = "shard") -> dict[str, bytes]:
    """Return the files of a shard by path in a capture set.

    Args:
        archive: bytes from `pack`.
        name: name of the archive in error messages.

    Raises:
        InputError: if the bytes are no archive, are cut short, or continue after its end. Also if
            a member is no regular file of a frame, or is repeated with another content.
    """
    contents: dict[str, bytes] = {}
    try:
        with tarfile.open(fileobj=io.BytesIO(archive), mode="r:") as read:
            for member in read:
                file = read.extractfile(member) if member.isreg() else None
                data = b"" if file is None else file.read()
                if file is None or len(data) != member.size or not _MEMBER.fullmatch(member.name):
                    raise _refuse_archive(name, f"the member {member.name[:80]!r}")
                place = _place(member.name)
                if contents.setdefault(place, data) != data:
                    raise _refuse_archive(name, f"two different {place[:80]}")
            if archive[read.offset :].strip(b"\0"):
                raise _refuse_archive(name, "data after its end")
    except InputError:
        raise
    except Exception as error:  # tarfile raises errors of many types for damaged archives.
        raise _refuse_archive(name, str(error) or type(error).__name__) from None
    if not contents:
        raise _refuse_archive(name, "no member")
    return contents


def _refuse_archive(name: str, value: str) -> InputError:
    return refuse(name, "must be a tar archive of frames", value, "Copy it again.")


def _place(member: str) -> str:
    """Return the path in a capture set of a member."""
    view, _, rest = member.partition("/")
    repeat, _, file = rest.partition(".")
    return f"{view}/{file}" if file in SHARED else f"{view}/{repeat}/{file}"


SHARED = frozenset({"camera.toml", "label.png", "room", "scene.toml", "truth.png"})
