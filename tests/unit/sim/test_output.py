"""Output is atomic, and --force never deletes folders that starling did not write."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from starling.patterns.errors import InputError
from starling.sim.console import output
from starling.sim.console.output import OutputFolder


def _everything(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def _write_one(path: Path, *, force: bool = False, text: str = "x") -> None:
    with OutputFolder(path, force=force) as folder:
        folder.write(output.RECORD, "{}")
        folder.write("a/0/depth.png", text)


def test_appears_under_its_name(tmp_path: Path) -> None:
    _write_one(tmp_path / "new" / "out")
    assert _everything(tmp_path / "new") == {
        "out",
        "out/starling.json",
        "out/a",
        "out/a/0",
        "out/a/0/depth.png",
    }
    _write_one(tmp_path / "new" / "out", force=True, text="y")
    assert (tmp_path / "new" / "out" / "a/0/depth.png").read_text() == "y"
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"out"}


def test_empty_folder_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    _write_one(tmp_path / "out")
    assert (tmp_path / "out" / "a/0/depth.png").exists()


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_interrupted_writing_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), OutputFolder(tmp_path / "new" / "out") as folder:
        folder.write("a/0/depth.png", "x")
        raise error
    assert _everything(tmp_path) == set()


def test_interrupted_replacing_keeps_the_old(tmp_path: Path) -> None:
    _write_one(tmp_path / "out")
    before = _everything(tmp_path)
    with pytest.raises(RuntimeError), OutputFolder(tmp_path / "out", force=True) as folder:
        folder.write("b/0/depth.png", "x")
        raise RuntimeError
    assert _everything(tmp_path) == before


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_full_disk_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    write = Path.write_bytes

    def fail(self: Path, data: bytes) -> int:
        if self.name == "depth.png":
            raise OSError(code, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", fail)
    message = "out must have room on its disk; got .*out, disk full. Free some space."
    with pytest.raises(InputError, match=message):
        _write_one(tmp_path / "new" / "out")
    assert _everything(tmp_path) == set()


def test_failed_renaming_restores_the_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _write_one(tmp_path / "out", text="old")
    before = _everything(tmp_path)
    rename = os.rename

    def fail(source: Path, target: Path) -> None:
        if str(source).endswith(".partial"):
            raise OSError(errno.EACCES, "Permission denied")
        rename(source, target)

    monkeypatch.setattr(os, "rename", fail)
    with pytest.raises(InputError, match=r"out must be writable; got .*Permission denied"):
        _write_one(tmp_path / "out", force=True)
    assert _everything(tmp_path) == before
    assert (tmp_path / "out/a/0/depth.png").read_text() == "old"


def test_occupied_places_are_refused(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"out must be an empty or new folder; got .*--force"):
        _write_one(tmp_path / "home")
    with pytest.raises(InputError, match="out must be a folder that starling wrote"):
        _write_one(tmp_path / "home", force=True)
    with pytest.raises(InputError, match="out must be a folder; got the file"):
        _write_one(tmp_path / "home" / "thesis.tex", force=True)
    with pytest.raises(InputError, match=r"out must be writable; got .*thesis.tex/sub"):
        _write_one(tmp_path / "home" / "thesis.tex" / "sub")
    assert _everything(tmp_path) == {"home", "home/thesis.tex"}


def test_unwritable_parent_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", fail)
    with pytest.raises(InputError, match=r"out must be writable; got .*Permission denied"):
        _write_one(tmp_path / "out")


def test_file_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "new" / "x.png"
    output.write_file(path, b"one")
    with pytest.raises(InputError, match=r"out must not exist; got .*--force"):
        output.write_file(path, b"two")
    output.write_file(path, b"two", force=True)
    assert path.read_bytes() == b"two"
    with pytest.raises(InputError, match="out must be a file; got the folder"):
        output.write_file(tmp_path, b"two")

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError, match="disk full"):
        output.write_file(path, b"three", force=True)
    assert path.read_bytes() == b"two"
    assert _everything(tmp_path) == {"new", "new/x.png"}


def test_parent_filled_by_another_process_stays(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), OutputFolder(tmp_path / "new" / "out") as folder:
        (tmp_path / "new" / "theirs").write_text("x")
        folder.write("a", "x")
        raise RuntimeError
    assert _everything(tmp_path) == {"new", "new/theirs"}


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("held_before", [False, True])
def test_folder_that_appears_meanwhile_is_never_lost(
    tmp_path: Path, force: bool, held_before: bool
) -> None:
    out = tmp_path / "out"
    if held_before:
        out.mkdir()
    with (
        pytest.raises(InputError, match=r"out must be an empty or new folder|that starling wrote"),
        OutputFolder(out, force=force) as folder,
    ):
        folder.write(output.RECORD, "{}")
        out.mkdir(exist_ok=True)
        (out / "thesis.tex").write_text("years of work")
    assert _everything(tmp_path) == {"out", "out/thesis.tex"}


def test_rename_without_force_never_replaces_a_full_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Holds for a folder that is filled between the last check and the rename."""
    monkeypatch.setattr(output, "_refuse_occupied", lambda *_, **__: None)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="out must be writable"):
        _write_one(tmp_path / "out")
    assert _everything(tmp_path) == {"out", "out/thesis.tex"}


def test_termination_between_the_renames_keeps_the_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write_one(tmp_path / "out", text="old")
    before = _everything(tmp_path)
    rename = os.rename

    def stop(source: Path, target: Path) -> None:
        if str(source).endswith(".partial"):
            raise SystemExit(143)
        rename(source, target)

    monkeypatch.setattr(os, "rename", stop)
    with pytest.raises(SystemExit):
        _write_one(tmp_path / "out", force=True)
    assert _everything(tmp_path) == before


def test_file_that_appears_meanwhile_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, write = tmp_path / "x.png", Path.write_bytes

    def write_late(self: Path, data: bytes) -> int:
        path.write_text("theirs")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", write_late)
    with pytest.raises(InputError, match="out must not exist"):
        output.write_file(path, b"mine")
    assert path.read_text() == "theirs" and _everything(tmp_path) == {"x.png"}


def test_symbolic_links_are_followed(tmp_path: Path) -> None:
    _write_one(tmp_path / "real", text="old")
    (tmp_path / "link").symlink_to("real")
    _write_one(tmp_path / "link", force=True, text="new")
    assert {path.name for path in tmp_path.iterdir()} == {"real", "link"}
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "a/0/depth.png").read_text() == "new"


def test_impossible_names_are_refused_before_any_work(tmp_path: Path) -> None:
    long = tmp_path / "new" / ("x" * 300)
    with pytest.raises(InputError, match=r"out must be writable; got .*too long"):
        OutputFolder(long).__enter__()
    with pytest.raises(InputError, match=r"out must be writable; got .*too long"):
        output.write_file(long, b"x")
    for root in ("/", "//", "/tmp/.."):
        with pytest.raises(InputError, match="out must have a name; got /"):
            OutputFolder(root)
    assert not any(tmp_path.rglob("*"))
    _write_one(tmp_path / ("x" * 250))
    assert len(list(tmp_path.iterdir())) == 1


def test_unreadable_parent_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "exists", fail)
    with pytest.raises(InputError, match=r"out must be writable; got .*Permission denied"):
        OutputFolder(tmp_path / "out").__enter__()
    with pytest.raises(InputError, match=r"out must be writable; got .*Permission denied"):
        output.write_file(tmp_path / "x.png", b"x")


@pytest.mark.parametrize("out", ["set", "set/a", "set/a/0/x.png", ".", "link", "link/new"])
def test_own_input_is_refused(tmp_path: Path, out: str) -> None:
    source = tmp_path / "set"
    (source / "a" / "0").mkdir(parents=True)
    (tmp_path / "link").symlink_to("set")
    with pytest.raises(InputError, match="out must lie outside its input; got "):
        output.refuse_own_input(tmp_path / out, source)
    output.refuse_own_input(tmp_path / "set2", source)


@pytest.mark.parametrize("name", ["../a", "a/../../b", "/tmp/a", "", ".", "a\0b"])
def test_a_file_outside_the_output_folder_is_refused(tmp_path: Path, name: str) -> None:
    refused = pytest.raises(InputError, match="output file must stay in its folder")
    with refused, OutputFolder(tmp_path / "out") as folder:
        folder.write(name, b"")
    assert not list(tmp_path.iterdir())
