"""Random mutations of files. The same format and number always give the same bytes."""

from __future__ import annotations

import copy
import io
import json
import random
import re
import tomllib
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import tomli_w

Mutator = Callable[[bytes, random.Random], bytes]

# Values as JSON or TOML texts.
_TOKENS = (
    *("null", "NaN", "nan", "Infinity", "-inf", "1e400", "-1e400", "1e-400", "-1", "0", "-0.0"),
    *("true", "9" * 30, "9" * 400, "9" * 5000, str(2**31), str(2**63), str(2**63 - 1), "1e300"),
    *('""', '"x"', '"../../x"', '"/etc/passwd"', '"a\\u0000b"', '"\\ud800"', '"a\\nb"', '"*"'),
    *("[]", "[[]]", "[[1, 2], [3]]", "[null]", "{}", '{"a": 1}', '"' + "y" * 3000 + '"'),
    *("[" * 40 + "]" * 40, "[" * 5000 + "]" * 5000, '{"a":' * 3000 + "1" + "}" * 3000),
    *("1979-05-27", "07:32:00", "{low = 1, high = 0}", "{of = []}", "0x" + "f" * 6000, "[1, 'x']"),
)
_WORDS = (
    *("nan", "inf", "-inf", "1e400", "-1", "0", "1e300", "9" * 30, "9" * 400, "9" * 5000, "x", "#"),
    *("../../x", "/etc/passwd", "\x00", "é", "٣", "1_0", "0x10", "1e-320", '"', ",", "y" * 3000),
)
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)


def mutate(data: bytes, how: Mutator, rng: random.Random) -> bytes:
    """Apply one to three mutations, of the format or of plain bytes."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = (how if rng.random() < 0.7 else plain)(data, rng)
    return data


def plain(data: bytes, rng: random.Random) -> bytes:
    """Flip, set, insert, delete, repeat, swap or cut bytes, or overwrite them with a number."""
    size = len(data)
    start = rng.randrange(min(size, rng.choice((32, 512, 2**30))) + 1)
    end = min(size, start + rng.choice((1, 2, 4, 8, 64, 512)))
    how = rng.randrange(8)
    if how == 0 and start < size:
        return data[:start] + bytes([data[start] ^ (1 << rng.randrange(8))]) + data[start + 1 :]
    if how == 1:
        return data[:start] + rng.randbytes(end - start) + data[end:]
    if how == 2:
        return data[:start] + rng.randbytes(rng.randrange(1, 40)) + data[start:]
    if how == 3:
        return data[:start] + data[end:]
    if how == 4:
        return data[:end] + data[start:end] * rng.randrange(1, 4) + data[end:]
    if how == 5:
        other = rng.randrange(end, size + 1)
        tail = other + end - start
        return data[:start] + data[other:tail] + data[end:other] + data[start:end] + data[tail:]
    if how == 6:
        width = rng.choice((1, 2, 4, 8))
        number = rng.choice(_NUMBERS) % 256**width
        written = number.to_bytes(width, rng.choice(("little", "big")))
        return data[:start] + written + data[start + width :]
    return data[:start]


def encoding(data: bytes, rng: random.Random) -> bytes:
    """Change the encoding of a text, its line ends or its byte order mark."""
    text = data.decode("utf-8", "replace")
    return rng.choice(
        (
            b"\xef\xbb\xbf" + data,
            b"\xef\xbb\xbf" * 2 + data,
            text.encode("utf-16"),
            text.encode("utf-16-le", "replace"),
            text.encode("utf-32"),
            text.replace("a", "é").encode("latin-1", "replace"),
            data.replace(b"\n", b"\r\n"),
            data.replace(b"\n", b"\x00\n"),
            data.replace(b"\n", "\u2028".encode()),
            data.decode("latin-1").encode("cp500", "replace"),
        )
    )


def _slots(tree: Any) -> list[tuple[Any, Any]]:
    """List (container, key) of all values in nested tables and lists."""
    keys = tree.keys() if isinstance(tree, dict) else range(len(tree))
    slots = [(tree, key) for key in keys]
    for _, key in list(slots):
        if isinstance(tree[key], (dict, list)):
            slots += _slots(tree[key])
    return slots


def tree(values: Any, rng: random.Random, new: Callable[[], Any]) -> Any:
    """Return nested tables and lists with one value dropped, renamed, repeated or replaced."""
    values = copy.deepcopy(values)
    slots = _slots(values) if isinstance(values, (dict, list)) else []
    if not slots:
        return new()
    container, key = rng.choice(slots)
    how = rng.randrange(8)
    if how == 0:
        del container[key]
    elif how == 1 and isinstance(container, dict):
        renamed = rng.choice((str(key)[1:], f"{key}x", "", "kind", "a.b", str(key).upper(), "é\n"))
        container[renamed] = container.pop(key)
    elif how == 2:
        container[key] = [container[key]] * rng.randrange(3)
    elif how == 3:
        other, second = rng.choice(slots)
        container[key] = copy.deepcopy(other[second])
    else:
        container[key] = new()
    return values


def _dumped(values: Any, rng: random.Random, dump: Callable[[Any], str]) -> bytes:
    """Dump mutated values; a mark stands for a token until the text is complete."""
    mark = "@@token@@"
    try:
        text = dump(tree(values, rng, lambda: mark))
    except (TypeError, ValueError, AttributeError):  # TOML has no null and needs a table.
        text = mark
    return text.replace(f'"{mark}"', rng.choice(_TOKENS)).encode("utf-8", "surrogatepass")


def json_text(data: bytes, rng: random.Random) -> bytes:
    """Mutate a value or the encoding of JSON."""
    try:
        values = json.loads(data)
    except (ValueError, RecursionError):
        return plain(data, rng)
    return encoding(data, rng) if rng.random() < 0.1 else _dumped(values, rng, json.dumps)


def toml_text(data: bytes, rng: random.Random) -> bytes:
    """Mutate a value or the encoding of TOML."""
    try:
        values = tomllib.loads(data.decode())
    except (ValueError, RecursionError):
        return plain(data, rng)
    return encoding(data, rng) if rng.random() < 0.1 else _dumped(values, rng, tomli_w.dumps)


def words(data: bytes, rng: random.Random) -> bytes:
    """Drop, repeat, replace or swap a word or a line of a text, or change its encoding."""
    if rng.random() < 0.1:
        return encoding(data, rng)
    split = re.split(rb"(\n)" if rng.random() < 0.3 else rb"([\s\"',<>/=]+)", data)
    place = rng.randrange(0, len(split), 2)
    other = rng.randrange(0, len(split), 2)
    how = rng.randrange(6)
    if how == 0:
        split[place] = b""
    elif how == 1:
        split[place] = split[place] + b" " + split[place]
    elif how == 2:
        split[place], split[other] = split[other], split[place]
    else:
        split[place] = rng.choice(_WORDS).encode()
    return b"".join(split)


def png(data: bytes, rng: random.Random) -> bytes:
    """Mutate the chunks of a PNG and correct their checksums."""
    chunks, position = [], 8
    while position + 12 <= len(data):
        end = position + 8 + int.from_bytes(data[position : position + 4], "big")
        chunks.append((data[position + 4 : position + 8], data[position + 8 : end]))
        position = end + 4
    if not chunks:
        return plain(data, rng)
    place = rng.randrange(len(chunks))
    kind, content = chunks[place]
    how = rng.randrange(6)
    if how == 0:
        extra = rng.choice((b"tRNS", b"PLTE", b"iCCP", b"eXIf", b"acTL", b"fcTL", b"gAMA", b"IDAT"))
        chunks.insert(place, (extra, rng.randbytes(rng.randrange(40))))
    elif how == 1:
        chunks[place] = (rng.choice((b"IDAT", b"IHDR", b"IEND", b"zTXt", b"\x00\xff??")), content)
    elif how == 2 and kind == b"IDAT":
        try:
            content = plain(zlib.decompress(content), rng) * rng.choice((1, 1, 50))
        except zlib.error:
            content = b""
        chunks[place] = (kind, zlib.compress(content, rng.randrange(10)))
    elif how == 3:
        chunks.insert(rng.randrange(len(chunks)), chunks.pop(place))
    else:
        chunks[place] = (kind, plain(content, rng))
    written = (
        len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4)
        for kind, content in chunks
    )
    return data[:8] + b"".join(written)


def zip_archive(data: bytes, rng: random.Random) -> bytes:
    """Mutate, rename, drop or repeat a member of a ZIP archive, with correct checksums."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # zipfile raises errors of many types for damaged archives.
        return plain(data, rng)
    if not members:
        return plain(data, rng)
    place = rng.randrange(len(members))
    name, content = members[place]
    how = rng.randrange(8)
    if how == 0:
        del members[place]
    elif how == 1:
        renamed = (f"{name}x", "version.npy", "kind.npy", "../x.npy", members[0][0])
        members[place] = (rng.choice(renamed), content)
    elif name.endswith(".npy") and how < 6:
        members[place] = (name, _npy(content, rng))
    else:
        members[place] = (name, plain(content, rng))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in dict(members).items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _npy(content: bytes, rng: random.Random) -> bytes:
    """Change the type, the shape or a value of an array, or the text of its header."""
    if rng.random() < 0.3:
        start = content.find(b"{")
        end = content.find(b"\n", start)
        numbers = (b"1" + b"0" * 12, b"-1", b"None", b"9" * 400, b"'|O'", b"(" * 200, b"'<U9'")
        new = (
            words(content[start:end], rng)
            if rng.random() < 0.5
            else re.sub(
                rb"\d+|'[<|].\d+'", lambda _: rng.choice(numbers), content[start:end], count=1
            )
        )
        return content[:8] + (len(new) + 1).to_bytes(4, "little")[:2] + new + content[end:]
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
        kinds = ("float64", "int8", "U4", "complex64", "bool", "M8[s]", "S3", "float16", "uint64")
        change = rng.randrange(5)
        with np.errstate(all="ignore"):
            if change == 0:
                array = array.astype(rng.choice(kinds))
            elif change == 1:
                array = array.reshape(rng.choice(((-1,), (1, -1), (-1, 1), (1, *array.shape))))
            elif change == 2:
                array = np.repeat(np.ravel(array), rng.choice((0, 2)))
            elif change == 3:
                array = np.array(rng.choice((np.nan, 1e300, -1, "x", True, 2**63)))
            elif array.size:
                array = array.copy()
                array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, -1, 1e30, 2e9))
    except Exception:  # The damaged array, or the change of its type, is impossible.
        return plain(content, rng)
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def tar(data: bytes, rng: random.Random) -> bytes:
    """Mutate a header of a tar archive and correct its checksum."""
    headers = [at for at in range(0, len(data) - 511, 512) if data[at + 257 : at + 262] == b"ustar"]
    if not headers:
        return plain(data, rng)
    start = rng.choice(headers)
    header = bytearray(data[start : start + 512])
    fields = ((0, 100), (100, 8), (124, 12), (136, 12), (156, 1), (157, 100), (345, 155))
    at, size = rng.choice(fields)
    field = rng.choice(
        (
            *(b"../../x", b"/etc/x", b"", b"\x80" + b"\xff" * 11, b"77777777777\x00", b"-1"),
            *(b"a/0.b", b"a/0.\xff\xfe", b"2", b"5", b"x", b"g", b"L", b"S", b"K", b"6"),
        )
    )
    header[at : at + size] = field[:size].ljust(size, b"\x00")
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\x00 " % sum(header)
    return data[:start] + bytes(header) + data[start + 512 :]


def glb(data: bytes, rng: random.Random) -> bytes:
    """Mutate the JSON of a binary glTF and correct the lengths."""
    size = int.from_bytes(data[12:16], "little")
    content = json_text(data[20 : 20 + size].rstrip(), rng)
    content += b" " * (-len(content) % 4)
    rest = data[20 + size :]
    head = data[:8] + (20 + len(content) + len(rest)).to_bytes(4, "little")
    return head + len(content).to_bytes(4, "little") + data[16:20] + content + rest


def parquet(data: bytes, rng: random.Random) -> bytes:
    """Change the type, the name or a value of a column of a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    try:
        table = pq.read_table(io.BytesIO(data))
        rows = tree(table.to_pylist(), rng, lambda: rng.choice((None, -1, 2**62, 1.5, "../x", [])))
        names = [name for name in table.column_names if rng.random() < 0.97]
        columns = {name: pa.array([row.get(name) for row in rows]) for name in names}
        if rng.random() < 0.7:
            columns = {
                name: values.cast(table.schema.field(name).type) for name, values in columns.items()
            }
        buffer = io.BytesIO()
        pq.write_table(pa.table(columns), buffer)
    except Exception:  # The damaged table, or the change of its type, is impossible.
        return plain(data, rng)
    return buffer.getvalue()


def torch_archive(data: bytes, rng: random.Random) -> bytes:
    """Change an entry of a checkpoint, or mutate a member of its archive."""
    import torch

    if rng.random() < 0.5:
        return zip_archive(data, rng)
    strange = (
        *(None, float("nan"), -1, 10**30, "x", [], {}, (), True, b"x", {1: 2}, [[[]]]),
        *(torch.zeros(0), torch.tensor(1.0), torch.ones(2, 3), torch.ones(4, 3).to_sparse()),
        *(torch.ones(4, 3).to(kind) for kind in (torch.bool, torch.complex64, torch.float16)),
        *(torch.full((4, 3), float("nan")), torch.zeros(1).expand(4, 3), torch.Size([2])),
        *(torch.quantize_per_tensor(torch.ones(4, 3), 0.1, 0, torch.qint8), torch.float32),
        torch.ones(4, 3, device="meta"),
    )
    try:
        values = torch.load(io.BytesIO(data), weights_only=True)
        buffer = io.BytesIO()
        torch.save(tree(values, rng, lambda: rng.choice(strange)), buffer)
    except Exception:  # The damaged archive raises errors of many types.
        return plain(data, rng)
    return buffer.getvalue()
