"""Data sets in any layout: listed without reading, read as pairs, trained and judged by verbs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.learning.completion.data.fingerprint import fingerprint
from starling.learning.completion.data.layouts import LAYOUTS, chosen, listed, readings
from starling.learning.completion.data.readers import item
from starling.learning.completion.evaluation.training_rooms import learnt_from
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.console import progress
from tests.unit.command_line import Capsys, refused
from tests.unit.learning import capture_sets
from tests.unit.learning.completion import tiny_data_sets
from tests.unit.learning.completion.test_completion_verbs import ran

PUBLIC = tuple(layout for layout in LAYOUTS if layout != "captures")


@pytest.mark.parametrize("layout", PUBLIC)
def test_an_item_becomes_a_pair(layout: str, tmp_path: Path) -> None:
    frames = listed(str(tiny_data_sets.write(layout, tmp_path)), layout)
    assert [one.room for one in frames] == list(tiny_data_sets.ROOMS[layout])
    for one, found in zip(frames, readings(frames, progress.silent, ""), strict=True):
        assert (found.scene, found.room, found.number) == (one.name, one.room, 0)
        assert found.image.shape == (*tiny_data_sets.SHAPE, 3)
        truth, depth, valid = found.truth(), found.depth_m, found.valid
        assert 0.3 < valid.mean() < 1
        off = np.abs(depth[valid] / truth[valid] - 1)
        assert np.median(off) < 0.02
        causes = found.causes()
        total = np.sum([mask.astype(int) for mask in causes.values()], axis=0)
        np.testing.assert_array_equal(total, (~valid).astype(int))
        if layout == "nyuv2":
            assert list(causes) == ["unknown"] and not valid[20:44, 70:110].any()
        else:
            assert "outside_overlap" in causes
            at = truth * found.focal_baseline_px_m**-1  # Depth is focal x baseline / disparity.
            np.testing.assert_allclose(1 / at, tiny_data_sets.DISPARITY_PX, rtol=1e-3)


def test_captures_are_listed_frame_by_frame(tmp_path: Path) -> None:
    frames = listed(str(capture_sets.write(tmp_path / "set")), "captures")
    assert [one.name for one in frames] == [f"{room}-view/0" for room in capture_sets.ROOMS]
    assert [one.load().room for one in frames] == list(capture_sets.ROOMS)


def test_some_are_chosen_by_room_and_evenly(tmp_path: Path) -> None:
    frames = listed(str(capture_sets.write(tmp_path / "set")), "captures")
    assert chosen(frames) == frames
    assert [one.room for one in chosen(frames, ["hall", "attic"])] == ["attic", "hall"]
    assert [one.room for one in chosen(frames, most=2)] == ["attic", "hall"]
    with pytest.raises(InputError, match=r"frames must be in \[1, 4\]; got 5\. There are 4\."):
        chosen(frames, most=5)
    with pytest.raises(InputError, match="room must be a known name; got 'loft'"):
        chosen(frames, ["loft"])
    with pytest.raises(InputError, match="rooms must be at least one; got none"):
        chosen(frames, [])


@pytest.mark.parametrize("verb", ["train", "evaluate"])
def test_nothing_is_written_into_what_is_read(verb: str, tmp_path: Path, capsys: Capsys) -> None:
    """Of one scene, not into its set either."""
    captures = capture_sets.write(tmp_path / "set")
    rooms = tiny_data_sets.write("irs", tmp_path / "rooms")
    flags = ("--methods", "nearest") if verb == "evaluate" else ()
    for place, layout, out in (
        (captures / "hall-view", "captures", captures / "out"),
        (rooms, "irs", rooms / "out"),
    ):
        command = (verb, "completion", place, "--layout", layout, "--out", out, *flags)
        assert "out must lie apart from what it is made from" in refused(*command, capsys=capsys)


def test_layouts_refuse(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"layout must be a known name; got 'isr'\. Known: irs"):
        listed(str(tmp_path), "isr")
    with pytest.raises(InputError, match="image must be chosen of captures alone; got rgb"):
        listed(str(tmp_path), "irs", "rgb")


def unreadable(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is read of images from here on."""
    read: list[str] = []

    def noted(take: Any) -> Any:
        def taken(path: Path, *rest: Any) -> Any:
            read.append(str(path))
            return take(path, *rest)

        return taken

    monkeypatch.setattr(png, "read", noted(png.read))
    monkeypatch.setattr(item, "_image", noted(item._image))
    return read


@pytest.mark.parametrize("layout", ["captures", "irs", "vkitti2"])
def test_nothing_is_read_before_it_is_asked_for(
    layout: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = capture_sets.write if layout == "captures" else _writer(layout)
    place = str(write(tmp_path / "set"))
    read = unreadable(monkeypatch)
    frames = listed(place, layout)
    fingerprint(frames)
    told = readings(frames, progress.silent, "")
    assert not read
    next(told)
    assert read and all(frames[1].name.split("/")[0] not in path for path in read)


def _writer(layout: str) -> Any:
    return lambda root: tiny_data_sets.write(layout, root)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_fingerprint_is_of_what_is_in_files_not_of_where_and_when(
    layout: str, tmp_path: Path
) -> None:
    write = capture_sets.write if layout == "captures" else _writer(layout)
    first, other = (
        fingerprint(listed(str(write(tmp_path / name)), layout)) for name in ("first", "other")
    )
    if layout != "nyuv2":  # HDF5 keeps when its parts were written.
        assert first == other


def test_a_fingerprint_tells_of_one_pixel_in_the_middle(tmp_path: Path) -> None:
    """Of a file whose size stays."""
    place = capture_sets.write(tmp_path / "set")
    before = fingerprint(listed(str(place), "captures"))
    path = place / "cellar-view" / "0" / "ir_left.png"
    size, image = path.stat().st_size, png.read(path, "image")
    for level in range(256):
        changed = image.copy()
        changed[24, 30] = level
        data = png.encode(changed)
        if level != image[24, 30] and len(data) == size:
            break
    else:
        pytest.fail("no other level has the same size")
    path.write_bytes(data)
    assert fingerprint(listed(str(place), "captures")) != before


def test_a_fingerprint_names_what_is_missing(tmp_path: Path) -> None:
    place = capture_sets.write(tmp_path / "set")
    (place / "hall-view" / "truth.png").unlink()
    expected = r"frame hall-view/0 must have truth.png to be learnt from; got none\. Leave it out"
    with pytest.raises(InputError, match=expected):
        fingerprint(listed(str(place), "captures"))


@pytest.mark.parametrize("layout", PUBLIC)
def test_verbs_train_and_judge_any_layout(layout: str, tmp_path: Path, capsys: Capsys) -> None:
    place = tiny_data_sets.write(layout, tmp_path / "data")
    how = ("--layout", layout)
    model = tmp_path / "model"
    told = ran(capsys, "train", "completion", place, *how, "--out", model, "--steps", 1)
    assert told["frames"] == 2 and told["left_out"] == 0 and told["hole_share"] > 0
    words = ("nearest", f"small={model}")
    out = tmp_path / "judged"
    found = ran(capsys, "evaluate", "completion", place, *how, "--methods", *words, "--out", out)
    assert found["frames"] == 2
    assert set(found["rooms"]["nearest"]) == set(tiny_data_sets.ROOMS[layout])
    assert found["methods"]["nearest"]["all"]["missing"] == 0
    assert found["methods"]["nearest"]["all"]["absrel"] < 0.2
    assert (out / "worst.png").exists()


def test_several_data_sets_are_learnt_from_together(tmp_path: Path, capsys: Capsys) -> None:
    streets = tiny_data_sets.write("vkitti2", tmp_path / "streets")
    rooms = tiny_data_sets.write("irs", tmp_path / "rooms")
    also = f"irs={rooms}"
    train = ("train", "completion", streets, "--layout", "vkitti2", "--steps", 1, "--also")
    told = ran(capsys, *train, also, "--frames", 3, "--out", tmp_path / "model")
    assert told["frames"] == 3
    assert learnt_from(f"small={tmp_path / 'model'}", str(rooms), ["Flat"]) == ["Flat"]
    out = ("--out", tmp_path / "other")
    assert "also must be LAYOUT=PLACE; got data" in refused(*train, "data", *out, capsys=capsys)
    said = refused(*train, "isr=data", *out, capsys=capsys)
    assert "layout must be a known name; got 'isr'" in said


def emptied(captures: Path, scenes: Sequence[str]) -> None:
    for scene in scenes:
        path = captures / scene / "0" / "depth.png"
        path.write_bytes(png.encode(np.zeros(capture_sets.SHAPE, np.uint16)))


@pytest.mark.parametrize("holes", ["camera", "random"])
def test_frames_without_depth_are_left_out(holes: str, tmp_path: Path, capsys: Capsys) -> None:
    captures = capture_sets.write(tmp_path / "set")
    emptied(captures, capture_sets.SCENES[1:2])
    train = ("train", "completion", captures, "--steps", 1, "--holes", holes, "--out")
    told = ran(capsys, *train, tmp_path / "model")
    assert (told["frames"], told["left_out"]) == (3, 1) and told["hole_share"] < 1
    emptied(captures, capture_sets.SCENES)
    said = refused(*train, tmp_path / "other", capsys=capsys)
    assert "frames must have depth; got none in all 4. Give others" in said


@pytest.mark.parametrize(
    ("flag", "value"), [("variant", "controlnet"), ("variant", "rgbd"), ("at-once", 2)]
)
def test_what_only_a_generator_has_needs_one(
    flag: str, value: object, tmp_path: Path, capsys: Capsys
) -> None:
    captures, out = capture_sets.write(tmp_path / "set"), tmp_path / "out"
    train = ("train", "completion", captures, "--out", out, f"--{flag}", value)
    assert f"{flag} must come with --start; got {value}. Give" in refused(*train, capsys=capsys)
    assert not out.exists()


def test_without_torch_it_says_what_to_install(tmp_path: Path) -> None:
    captures = capture_sets.write(tmp_path / "set")
    program = (
        "import sys, starling\n"
        "class Absent:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'torch': raise ModuleNotFoundError('gone', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        f"given = ['train', 'completion', {str(captures)!r}, '--out', {str(tmp_path / 'out')!r}]\n"
        "sys.exit(starling.main(given))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "starling: small needs torch; got none. " in done.stderr
    assert "pip install -e '.[learning]'" in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_picture_is_chosen_of_captures_alone(tmp_path: Path, capsys: Capsys) -> None:
    """Where there are some among several data sets, of them."""
    place = tiny_data_sets.write("irs", tmp_path / "rooms")
    captures = capture_sets.write(tmp_path / "set")
    train = ("train", "completion", place, "--layout", "irs", "--image", "rgb", "--out")
    said = refused(*train, tmp_path / "out", capsys=capsys)
    assert "image must be chosen of captures alone; got rgb. Leave --image out" in said
    said = refused(*train, tmp_path / "out", "--also", f"captures={captures}", capsys=capsys)
    assert "frame 0 of attic-view must have rgb.png" in said


def judged(capsys: Capsys, captures: Path, out: Path, *flags: object) -> dict[str, Any]:
    words = ("--methods", "nearest", "poisson")
    return ran(capsys, "evaluate", "completion", captures, *words, "--out", out, *flags)


def test_alignment_to_the_truth_takes_away_what_scale_and_shift_explain(
    tmp_path: Path, capsys: Capsys
) -> None:
    """A camera that is off by 20 % is not, once its depth is brought to the truth."""
    captures = capture_sets.write(tmp_path / "set")
    for scene in capture.open_set(captures).scenes:
        path = scene.path / "0" / "depth.png"
        code = png.read(path, "depth")
        path.write_bytes(png.encode(np.round(1.2 * code).astype(np.uint16)))
    plain = judged(capsys, captures, tmp_path / "plain")
    truth = judged(capsys, captures, tmp_path / "truth", "--align", "truth")
    own = judged(capsys, captures, tmp_path / "own", "--align", "sensor")
    error = {
        name: found["methods"]["sensor"]["valid"]["absrel"]
        for name, found in (("plain", plain), ("truth", truth), ("own", own))
    }
    assert error["plain"] == pytest.approx(0.2, abs=0.01)
    assert error["own"] == pytest.approx(error["plain"], rel=1e-3)
    assert error["truth"] < 0.01
    for word in ("nearest", "poisson"):
        assert truth["methods"][word]["all"]["rmse_m"] < plain["methods"][word]["all"]["rmse_m"]
    kept = (tmp_path / "truth" / "starling.json").read_text()
    assert '"align": "truth"' in kept and '"layout": "captures"' in kept


def test_what_cannot_be_aligned_is_missing_in_its_frame_alone(
    tmp_path: Path, capsys: Capsys
) -> None:
    captures = capture_sets.write(tmp_path / "set")
    path = captures / "hall-view" / "0" / "depth.png"
    code = png.read(path, "depth")
    path.write_bytes(png.encode(np.where(code > 0, 1000, 0).astype(np.uint16)))  # All of one depth.
    found = judged(capsys, captures, tmp_path / "out", "--align", "truth")
    everything = found["rooms"]["nearest"]["hall"]["all"]
    assert everything["missing"] == everything["pixels"] > 0
    assert found["rooms"]["nearest"]["attic"]["all"]["missing"] == 0


def test_so_many_frames_are_judged(tmp_path: Path, capsys: Capsys) -> None:
    captures = capture_sets.write(tmp_path / "set")
    found = judged(capsys, captures, tmp_path / "out", "--frames", 2)
    assert found["frames"] == 2 and set(found["rooms"]["nearest"]) == {"attic", "hall"}
