"""Data sets in any layout: listing, reading, training and evaluation."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.learning.completion.commands.train_captures import VERB, training_rooms
from starling.learning.completion.data.layouts import (
    LAYOUTS,
    fingerprint,
    list_frames,
    read_frames,
    select_frames,
)
from starling.learning.completion.data.readers import item
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
    frames = list_frames(str(tiny_data_sets.write(layout, tmp_path)), layout)
    assert [frame.room for frame in frames] == list(tiny_data_sets.ROOMS[layout])
    for entry, result in zip(frames, read_frames(frames, progress.silent, ""), strict=True):
        assert (result.scene, result.room, result.number) == (entry.name, entry.room, 0)
        assert result.image.shape == (*tiny_data_sets.SHAPE, 3)
        truth, depth, valid = result.truth(), result.depth_m, result.valid
        assert 0.3 < valid.mean() < 1
        off = np.abs(depth[valid] / truth[valid] - 1)
        assert np.median(off) < 0.02
        causes = result.causes()
        total = np.sum([mask.astype(int) for mask in causes.values()], axis=0)
        np.testing.assert_array_equal(total, (~valid).astype(int))
        if layout == "nyuv2":
            assert list(causes) == ["unknown"] and not valid[20:44, 70:110].any()
        else:
            assert "outside_overlap" in causes
            position = (
                truth * result.focal_baseline_px_m**-1
            )  # Depth is focal x baseline / disparity.
            np.testing.assert_allclose(1 / position, tiny_data_sets.DISPARITY_PX, rtol=1e-3)


def test_captures_are_listed_frame_by_frame(tmp_path: Path) -> None:
    frames = list_frames(str(capture_sets.write(tmp_path / "set")), "captures")
    assert [frame.name for frame in frames] == [f"{room}-view/0" for room in capture_sets.ROOMS]
    assert [frame.load().room for frame in frames] == list(capture_sets.ROOMS)


def test_frames_are_selected_by_room_and_evenly(tmp_path: Path) -> None:
    frames = list_frames(str(capture_sets.write(tmp_path / "set")), "captures")
    assert select_frames(frames) == frames
    assert [frame.room for frame in select_frames(frames, ["hall", "attic"])] == ["attic", "hall"]
    assert [frame.room for frame in select_frames(frames, most=2)] == ["attic", "hall"]
    with pytest.raises(InputError, match=r"frames must be in \[1, 4\]; got 5\. There are 4\."):
        select_frames(frames, most=5)
    with pytest.raises(InputError, match="room must be a known name; got 'loft'"):
        select_frames(frames, ["loft"])
    with pytest.raises(InputError, match="rooms must be at least one; got none"):
        select_frames(frames, [])


@pytest.mark.parametrize("verb", ["train", "evaluate"])
def test_outputs_inside_the_data_set_are_refused(verb: str, tmp_path: Path, capsys: Capsys) -> None:
    """For one scene, the whole set is protected."""
    captures = capture_sets.write(tmp_path / "set")
    rooms = tiny_data_sets.write("irs", tmp_path / "rooms")
    flags = ("--methods", "nearest") if verb == "evaluate" else ()
    for place, layout, out in (
        (captures / "hall-view", "captures", captures / "out"),
        (rooms, "irs", rooms / "out"),
    ):
        command = (verb, "completion", place, "--layout", layout, "--out", out, *flags)
        assert "out must lie outside its input" in refused(*command, capsys=capsys)


def test_layouts_refuse(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"layout must be a known name; got 'isr'\. Known: irs"):
        list_frames(str(tmp_path), "isr")
    with pytest.raises(InputError, match="image can be chosen for captures only; got rgb"):
        list_frames(str(tmp_path), "irs", "rgb")


def unreadable(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Make all images unreadable."""
    read: list[str] = []

    def noted(take: Any) -> Any:
        def taken(path: Path, *rest: Any, **options: Any) -> Any:
            read.append(str(path))
            return take(path, *rest, **options)

        return taken

    monkeypatch.setattr(png, "read", noted(png.read))
    monkeypatch.setattr(item, "_image", noted(item._image))
    return read


@pytest.mark.parametrize("layout", ["captures", "irs", "vkitti2"])
def test_images_are_read_on_demand(
    layout: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = capture_sets.write if layout == "captures" else _writer(layout)
    place = str(write(tmp_path / "set"))
    read = unreadable(monkeypatch)
    frames = list_frames(place, layout)
    fingerprint(frames)
    report = read_frames(frames, progress.silent, "")
    assert not read
    next(report)
    assert read and all(frames[1].name.split("/")[0] not in path for path in read)


def _writer(layout: str) -> Any:
    return lambda root: tiny_data_sets.write(layout, root)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_fingerprint_ignores_folder_and_time(layout: str, tmp_path: Path) -> None:
    write = capture_sets.write if layout == "captures" else _writer(layout)
    first, second = (
        fingerprint(list_frames(str(write(tmp_path / name)), layout)) for name in ("first", "other")
    )
    if layout != "nyuv2":  # HDF5 stores the time of writing.
        assert first == second


def test_a_fingerprint_detects_one_changed_pixel(tmp_path: Path) -> None:
    """The file size does not change."""
    place = capture_sets.write(tmp_path / "set")
    before = fingerprint(list_frames(str(place), "captures"))
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
    assert fingerprint(list_frames(str(place), "captures")) != before


def test_a_fingerprint_names_missing_files(tmp_path: Path) -> None:
    place = capture_sets.write(tmp_path / "set")
    (place / "hall-view" / "truth.png").unlink()
    expected = r"frame hall-view/0 must have truth.png for training; got none\. Leave it out"
    with pytest.raises(InputError, match=expected):
        fingerprint(list_frames(str(place), "captures"))


@pytest.mark.parametrize("layout", PUBLIC)
def test_verbs_train_and_evaluate_any_layout(layout: str, tmp_path: Path, capsys: Capsys) -> None:
    place = tiny_data_sets.write(layout, tmp_path / "data")
    how = ("--layout", layout)
    model = tmp_path / "model"
    report = ran(capsys, "train", "completion", place, *how, "--out", model, "--steps", 1)
    assert report["frames"] == 2 and report["left_out"] == 0 and report["hole_share"] > 0
    words = ("nearest", f"small={model}")
    out = tmp_path / "judged"
    result = ran(capsys, "evaluate", "completion", place, *how, "--methods", *words, "--out", out)
    assert result["frames"] == 2
    assert set(result["rooms"]["nearest"]) == set(tiny_data_sets.ROOMS[layout])
    assert result["methods"]["nearest"]["all"]["missing"] == 0
    assert result["methods"]["nearest"]["all"]["absrel"] < 0.2
    assert (out / "worst.png").exists()


def test_training_on_several_data_sets(tmp_path: Path, capsys: Capsys) -> None:
    streets = tiny_data_sets.write("vkitti2", tmp_path / "streets")
    rooms = tiny_data_sets.write("irs", tmp_path / "rooms")
    also = f"irs={rooms}"
    train = ("train", "completion", streets, "--layout", "vkitti2", "--steps", 1, "--also")
    report = ran(capsys, *train, also, "--frames", 3, "--out", tmp_path / "model")
    assert report["frames"] == 3
    assert training_rooms(f"small={tmp_path / 'model'}", str(rooms), ["Flat"]) == ["Flat"]
    out = ("--out", tmp_path / "other")
    assert "also must be LAYOUT=PLACE; got data" in refused(*train, "data", *out, capsys=capsys)
    message = refused(*train, "isr=data", *out, capsys=capsys)
    assert "layout must be a known name; got 'isr'" in message


def emptied(captures: Path, scenes: Sequence[str]) -> None:
    for scene in scenes:
        path = captures / scene / "0" / "depth.png"
        path.write_bytes(png.encode(np.zeros(capture_sets.SHAPE, np.uint16)))


@pytest.mark.parametrize("holes", ["camera", "random"])
def test_frames_without_depth_are_left_out(holes: str, tmp_path: Path, capsys: Capsys) -> None:
    captures = capture_sets.write(tmp_path / "set")
    emptied(captures, capture_sets.SCENES[1:2])
    train = ("train", "completion", captures, "--steps", 1, "--holes", holes, "--out")
    report = ran(capsys, *train, tmp_path / "model")
    assert (report["frames"], report["left_out"]) == (3, 1) and report["hole_share"] < 1
    emptied(captures, capture_sets.SCENES)
    message = refused(*train, tmp_path / "other", capsys=capsys)
    assert "frames must have depth; got none in all 4. Give other frames" in message


@pytest.mark.parametrize(
    ("flag", "value"), [("variant", "controlnet"), ("variant", "rgbd"), ("at-once", 2)]
)
def test_options_of_generators_need_a_generator(
    flag: str, value: object, tmp_path: Path, capsys: Capsys
) -> None:
    captures, out = capture_sets.write(tmp_path / "set"), tmp_path / "out"
    train = ("train", "completion", captures, "--out", out, f"--{flag}", value)
    assert f"{flag} must come with --start; got {value}. Give" in refused(*train, capsys=capsys)
    assert not out.exists()


def test_missing_torch_is_named(tmp_path: Path) -> None:
    captures = capture_sets.write(tmp_path / "set")
    program = (
        "import sys\nfrom starling import command_line\n"
        "class Absent:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'torch': raise ModuleNotFoundError('gone', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        f"given = ['train', 'completion', {str(captures)!r}, '--out', {str(tmp_path / 'out')!r}]\n"
        "sys.exit(command_line.main(given))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "starling: small needs torch; got none. " in done.stderr
    assert "pip install -e '.[learning]'" in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_picture_applies_to_captures_only(tmp_path: Path, capsys: Capsys) -> None:
    """With several data sets, the picture applies to the captures."""
    place = tiny_data_sets.write("irs", tmp_path / "rooms")
    captures = capture_sets.write(tmp_path / "set")
    train = ("train", "completion", place, "--layout", "irs", "--image", "rgb", "--out")
    message = refused(*train, tmp_path / "out", capsys=capsys)
    assert "image can be chosen for captures only; got rgb. Leave --image out" in message
    message = refused(*train, tmp_path / "out", "--also", f"captures={captures}", capsys=capsys)
    assert "frame 0 of attic-view must have rgb.png" in message


def judged(capsys: Capsys, captures: Path, out: Path, *flags: object) -> dict[str, Any]:
    words = ("--methods", "nearest", "poisson")
    return ran(capsys, "evaluate", "completion", captures, *words, "--out", out, *flags)


def test_alignment_to_the_truth_removes_scale_and_shift(tmp_path: Path, capsys: Capsys) -> None:
    """A camera with an error of 20 % has none after alignment to the truth."""
    captures = capture_sets.write(tmp_path / "set")
    for scene in capture.open_set(captures).scenes:
        path = scene.path / "0" / "depth.png"
        code = png.read(path, "depth")
        path.write_bytes(png.encode(np.round(1.2 * code).astype(np.uint16)))
    plain = judged(capsys, captures, tmp_path / "plain")
    truth = judged(capsys, captures, tmp_path / "truth", "--align", "truth")
    original = judged(capsys, captures, tmp_path / "own", "--align", "sensor")
    error = {
        name: result["methods"]["sensor"]["valid"]["absrel"]
        for name, result in (("plain", plain), ("truth", truth), ("own", original))
    }
    assert error["plain"] == pytest.approx(0.2, abs=0.01)
    assert error["own"] == pytest.approx(error["plain"], rel=1e-3)
    assert error["truth"] < 0.01
    for word in ("nearest", "poisson"):
        assert truth["methods"][word]["all"]["rmse_m"] < plain["methods"][word]["all"]["rmse_m"]
    remaining = (tmp_path / "truth" / "starling.json").read_text()
    assert '"align": "truth"' in remaining and '"layout": "captures"' in remaining


def test_depth_that_cannot_be_aligned_is_missing_in_its_frame_only(
    tmp_path: Path, capsys: Capsys
) -> None:
    captures = capture_sets.write(tmp_path / "set")
    path = captures / "hall-view" / "0" / "depth.png"
    code = png.read(path, "depth")
    path.write_bytes(png.encode(np.where(code > 0, 1000, 0).astype(np.uint16)))  # Constant depth.
    result = judged(capsys, captures, tmp_path / "out", "--align", "truth")
    everything = result["rooms"]["nearest"]["hall"]["all"]
    assert everything["missing"] == everything["pixels"] > 0
    assert result["rooms"]["nearest"]["attic"]["all"]["missing"] == 0


def test_the_number_of_evaluated_frames(tmp_path: Path, capsys: Capsys) -> None:
    captures = capture_sets.write(tmp_path / "set")
    result = judged(capsys, captures, tmp_path / "out", "--frames", 2)
    assert result["frames"] == 2 and set(result["rooms"]["nearest"]) == {"attic", "hall"}


@pytest.mark.parametrize(
    "arguments", ["3", "{}", '{"captures": 3}', '{"captures": "a", "also": "b"}']
)
def test_damaged_records_of_a_training_are_refused(tmp_path: Path, arguments: str):
    path = tmp_path / "starling.json"
    path.write_text(f'{{"verb": "{VERB}", "arguments": {arguments}}}')
    with pytest.raises(InputError, match=r"starling\.json: arguments"):
        training_rooms(f"small={tmp_path}", "a", ["attic"])
