"""Sensor files that inherit from a base, and their refusals."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path

import pytest

from starling.patterns.errors import InputError
from starling.sim.sensor import presets, structure
from starling.sim.sensor.matcher import Block, named

# SHA-256 of the presets' fields as sorted JSON; results of the tables in docs depend on them.
DIGESTS = {
    "d415": "0cc62e0159c329d7",
    "d435": "85fdb0a8e496a397",
    "d455": "568d209eb5d53dfc",
    "kinect-v1": "11572ec752ee0898",
    "xtion": "84cf987d8955a7ad",
}


@pytest.mark.parametrize("name", DIGESTS)
def test_numbers_of_presets_are_unchanged(name: str) -> None:
    text = json.dumps(structure.to_table(presets.load(name)), sort_keys=True)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == DIGESTS[name]


def write(folder: Path, **texts: str) -> str:
    """Write sensor files by stem, and return the path of the first."""
    for stem, text in texts.items():
        (folder / f"{stem}.toml").write_text(text)
    return str(folder / f"{next(iter(texts))}.toml")


def test_a_file_inherits_all_it_does_not_give(tmp_path: Path) -> None:
    text = 'base = "d435"\nname = "mine"\nbaseline_m = 0.045\n[left.lens]\nblur_px = 0.9\n'
    base, mine = presets.load("d435"), presets.load(write(tmp_path, a=text))
    lens = dataclasses.replace(base.left.lens, blur_px=0.9)
    imager = dataclasses.replace(base.left, lens=lens)
    wanted = dataclasses.replace(base, name="mine", baseline_m=0.045, left=imager, right=imager)
    assert mine == wanted


def test_bases_form_a_chain_and_paths_start_at_each_file(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    light = '[projector]\npattern = "dots.png"\n'
    (tmp_path / "in" / "b.toml").write_text(f'base = "d435"\nunit = 7\n{light}')
    mine = presets.load(write(tmp_path, a='base = "in/b.toml"\nbaseline_m = 0.045\n'))
    assert (mine.unit, mine.baseline_m) == (7, 0.045)
    assert mine.projector.pattern == str(tmp_path / "in" / "dots.png")


def test_a_right_imager_of_its_own_stays(tmp_path: Path) -> None:
    base = 'base = "d435"\n[right]\nprnu = 0.02\n'
    mine = presets.load(write(tmp_path, a='base = "b.toml"\n[left]\ngain = 2.0\n', b=base))
    assert (mine.left.gain, mine.right.gain, mine.right.prnu) == (2.0, 1.0, 0.02)


def test_a_stock_setting_and_another_kind_replace_parts_of_the_base(tmp_path: Path) -> None:
    setting = 'base = "d415"\n[matcher]\nsetting = "fast"\nsearch_px = 144\n'
    mine = presets.load(write(tmp_path, a=setting))
    assert mine.matcher == dataclasses.replace(named("fast"), search_px=144)
    engine = 'base = "d415"\n[matcher.engine]\nkind = "Block"\n'
    assert presets.load(write(tmp_path, b=engine)).matcher.engine == Block()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('base = "d434"', r"^base must be a known name; got 'd434'\. Known: d435,.*\.toml file\.$"),
        (
            'base = "bb.toml"',
            r"^base must be a readable file; got .*bb.toml. No .* Nearest: b.toml",
        ),
        ('base = "a.toml"', r"^base must not lead back to its own file; got a.toml -> a.toml\."),
        ('base = "b.toml"', r"lead back to its own file; got a.toml -> b.toml -> c.toml -> a.toml"),
        ("base = 3", r"^base must be of type str; got 3"),
        ('camera_matrix = ""', r"^camera_matrix must name a file; got no text"),
        ("camera_matrix = 3", r"^camera_matrix must be of type str; got 3"),
        ("description = 3", r"^description must be of type str; got 3"),
        ('base = "d435"\nbaseline = 3', r"^key must be a known name; got 'baseline'. Known: base"),
        ('base = "d435"\nbaseline_m = 5e20', r"^baseline_m must be in \[0.0005, 10\]; got 5e\+20"),
        ('base = "d435"\nwidth = 0', r"^width must be in \[32, 8192\]; got 0"),
        ('base = "d435"\nunit = ' + "9" * 30, r"^sensor.unit must fit in 64 bits"),
        ('base = "d435"\nleft = 3', r"^left must be a table; got 3"),
        (
            'base = "d415"\n[projector]\npattern = "d435"',
            r"^projector.pattern must not be set where every emitter has its own; got 'd435'. Set",
        ),
        ('base = "broken.toml"', r"^base must be TOML; got .*broken.toml"),
        ('base = "a\\u0000.toml"', r"^base must be a readable file"),
    ],
)
def test_wrong_bases_are_refused_in_a_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, a=text, b='base = "c.toml"', c='base = "a.toml"', broken="name = ")
    with pytest.raises(InputError, match=message) as refusal:
        presets.load(path)
    assert "\n" not in str(refusal.value)


def test_an_unknown_sensor_says_that_a_path_goes_there_too() -> None:
    with pytest.raises(InputError, match=r"got 'd434'\. Known: d435, .*\. Or give the path of a"):
        presets.load("d434")


def test_a_missing_sensor_file_names_the_nearest(tmp_path: Path) -> None:
    write(tmp_path, camera='base = "d435"')
    with pytest.raises(InputError, match=r"No such file or directory. Nearest: camera.toml\.$"):
        presets.load(str(tmp_path / "camra.toml"))


def test_a_chain_of_bases_has_an_end(tmp_path: Path) -> None:
    """The base of the n-th file is the next one; sixteen are allowed."""
    texts = {f"a{number}": f'base = "a{number + 1}.toml"' for number in range(40)}
    path = write(tmp_path, **texts, a40='base = "d435"')
    with pytest.raises(InputError, match=r"^base must end after 16 files; got 17 files, a17.toml"):
        presets.load(path)
    assert presets.load(str(tmp_path / "a30.toml")) == presets.load("d435")
