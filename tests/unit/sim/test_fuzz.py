"""Any defect of a sensor file or capture folder gives a one-line error, never a traceback."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.commands import compare
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor import presets

PRESET = presets.text("d415")
_LINES = [line for line in PRESET.splitlines() if "=" in line and not line.startswith("#")]
_KEYS = sorted({line.partition("=")[0].strip() for line in _LINES})

_VALUES = st.one_of(
    st.sampled_from(
        [
            "0",
            "-1",
            "nan",
            "inf",
            "-inf",
            "1e400",
            "1e-400",
            "true",
            "''",
            "'x'",
            "[]",
            "{}",
            "[1, 2, 3]",
            "[[1]]",
            "{a = 1}",
            "{kind = 'x'}",
            "1979-05-27",
            "'''",
            "99999999999999",
        ]
    ),
    st.integers().map(str),
    st.integers(60, 1400).map(lambda bits: str(2**bits)),  # Overflows 64 bits, then a float.
    st.floats().map(str),
    st.text(max_size=8).map(json.dumps),
)
_EDITS = st.one_of(
    st.tuples(st.just("value"), st.sampled_from(_LINES), _VALUES),
    st.tuples(st.just("drop"), st.sampled_from(_LINES), st.just("")),
    st.tuples(st.just("key"), st.sampled_from(_LINES), st.text("abcdef_.[]", max_size=6)),
    st.tuples(st.just("insert"), st.sampled_from(_LINES), st.text(max_size=12)),
)


def _mutate(text: str, edits: list[tuple[str, str, str]]) -> str:
    for how, line, new in edits:
        key, _, value = line.partition("=")
        replacement = {
            "value": f"{key}= {new}",
            "drop": "",
            "key": f"{new} = {value}",
            "insert": f"{line}\n{new}",
        }[how]
        text = text.replace(line, replacement, 1)
    return text


def _quiet(function: Callable[[], object]) -> None:
    """Call a function that may raise only `InputError`, with a one-line message, or warn."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            function()
    except InputError as error:
        assert str(error) and "\n" not in str(error)


def _command(*arguments: str) -> None:
    """Run a command that succeeds or prints exactly one line."""
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(action="ignore"),
    ):
        code = command_line.main(arguments)
    if code:
        assert (code, out.getvalue()) == (1, "")
        assert err.getvalue().startswith("starling: ") and err.getvalue().count("\n") == 1
        assert "an error of starling itself" not in err.getvalue(), err.getvalue()


@settings(max_examples=150)
@given(edits=st.lists(_EDITS, min_size=1, max_size=3))
def test_sensor_files(tmp_path_factory: pytest.TempPathFactory, edits: list) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_text(_mutate(PRESET, edits), encoding="utf-8", errors="replace")
    _quiet(lambda: presets.load(str(path)))


@settings(max_examples=100)
@given(data=st.binary(max_size=60), position=st.integers(0, len(PRESET)))
def test_sensor_files_with_any_bytes(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, position: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    text = PRESET.encode()
    path.write_bytes(text[:position] + data + text[position + len(data) :])
    _quiet(lambda: presets.load(str(path)))


@settings(max_examples=200)
@example(table="projector.", key="power_w", value="1" + "0" * 400)
@example(table="", key="width", value=hex(2**20_000))
@example(table="matcher.", key="setting", value=hex(2**20_000))
@given(
    table=st.sampled_from(["", "left.", "imager.", "projector.", "matcher.", "post.", "x."]),
    key=st.one_of(st.sampled_from(_KEYS), st.text(max_size=6)),
    value=_VALUES,
)
def test_edits(table: str, key: str, value: str) -> None:
    sensor = presets.load("d415")
    _quiet(lambda: sensor_edits.apply(sensor, [f"{table}{key}={value}"]))


_FILES = (
    "capture.toml",
    "a/room",
    "a/truth.png",
    "a/0/ir_left.png",
    "a/0/ir_right.png",
    "a/0/depth.png",
    "a/0/frame.json",
    "a/0",
    "a",
)
_DAMAGE = st.one_of(
    st.just(("remove",)),
    st.just(("empty",)),
    st.just(("folder",)),
    st.tuples(st.just("cut"), st.floats(0, 1)),
    st.tuples(st.just("byte"), st.floats(0, 1), st.integers(0, 255)),
    st.tuples(st.just("replace"), st.binary(max_size=40)),
    st.tuples(st.just("copy"), st.sampled_from(_FILES[:7])),
    st.tuples(st.just("insert"), st.floats(0, 1), st.binary(max_size=8)),
)


def _damage(folder: Path, name: str, damage: tuple) -> None:
    path = folder / name
    if not path.exists():
        return
    how, *values = damage
    if path.is_dir() or how in ("remove", "folder"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        if how == "folder":
            path.mkdir()
        return
    path.write_bytes(_damaged(path.read_bytes(), folder, how, values))


def _damaged(data: bytes, folder: Path, how: str, values: list) -> bytes:
    if how == "empty":
        return b""
    if how == "replace":
        return values[0]
    if how == "copy":
        second = folder / values[0]
        return second.read_bytes() if second.is_file() else data
    position = int(values[0] * len(data))
    if how == "cut":
        return data[:position]
    if how == "insert":
        return data[:position] + values[1] + data[position:]
    return data[:position] + bytes([values[1]]) + data[position + 1 :]  # Change a byte, or add one.


def _read_all(folder: Path) -> None:
    captures = capture.open_set(folder)
    for scene in captures.scenes:
        scene.truth_m()
        for number in scene.frames:
            scene.frame(number)
    compare.compare(captures, captures)


@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(damages=st.lists(st.tuples(st.sampled_from(_FILES), _DAMAGE), min_size=1, max_size=3))
def test_capture_folders(
    tmp_path_factory: pytest.TempPathFactory, write_set: Callable[..., Path], damages: list
) -> None:
    folder = tmp_path_factory.mktemp("fuzz") / "set"
    write_set(folder, scenes=("a",))
    for name, damage in damages:
        _damage(folder, name, damage)
    _quiet(lambda: _read_all(folder))
    _command("compare", str(folder), str(folder / "a"))
    shutil.rmtree(folder, ignore_errors=True)


@settings(max_examples=60)
@given(arguments=st.lists(st.text("abc./-=0 \n", min_size=1, max_size=6), max_size=2))
def test_command_line_arguments(arguments: list[str]) -> None:
    values = [text for text in arguments if not text.startswith("-")]
    for text in values:
        _command("sensors", "show", text)
        _command("compare", text, text)
        _command("match", text, "--sensor", "d415", f"--set={text}")
