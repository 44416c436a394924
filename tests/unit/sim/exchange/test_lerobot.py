"""A LeRobot data set, read back by pyarrow; `lerobot` itself demands Python 3.12 and more."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.exchange.lerobot import dataset, statistics, tables

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra lerobot is not installed")

IMAGES = "observation.images."
FRAMES = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"


def exported(folder: Path, **more: Any) -> Path:
    """Export a set, and return the folder of the data set."""
    out = folder.parent / "lerobot"
    dataset.export(capture.open_set(folder), out, **more)
    return out


def rows(path: Path) -> list[dict[str, Any]]:
    return parquet.read_table(path).to_pylist()


def features(out: Path) -> dict[str, Any]:
    return json.loads((out / "meta" / "info.json").read_text())["features"]


def decoded(row: dict[str, Any], name: str) -> np.ndarray:
    """Decode an image cell to its stored values; colours are red, green, blue."""
    data = np.frombuffer(row[IMAGES + name]["bytes"], np.uint8)
    image = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))
    return image[..., ::-1] if image.ndim == 3 else image


def edit_info(folder: Path, old: str, new: str) -> None:
    file = folder / "capture.toml"
    file.write_text(file.read_text().replace(old, new))


def add_colour(folder: Path, name: str = "a", shape: tuple[int, int] = (24, 32)) -> np.ndarray:
    """Write a picture and aligned depth into a scene."""
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 255, (*shape, 3)).astype(np.uint8)
    aligned = rng.integers(0, 3000, shape).astype(np.uint16)
    (folder / name / "0" / "rgb.png").write_bytes(png.encode_colour(picture))
    (folder / name / "0" / "depth_colour.png").write_bytes(png.encode(aligned))
    return picture


def set_times(folder: Path, **times_s: float) -> None:
    for name, time_s in times_s.items():
        (folder / name / "0" / "frame.json").write_text(json.dumps({"timestamp": time_s}))


def test_images_are_those_of_the_captures(small_set: Path):
    out = exported(small_set)
    scenes = capture.open_set(small_set).scenes
    read = rows(out / FRAMES)
    assert len(read) == len(scenes) == 2
    for row, scene in zip(read, scenes, strict=True):
        frame = scene.frame(0)
        code = cv2.imread(str(scene.path / "0" / "depth.png"), cv2.IMREAD_UNCHANGED)
        depth = decoded(row, "depth")
        assert depth.dtype == np.uint16
        np.testing.assert_array_equal(depth, code)
        for name, image in (("infrared_left", frame.ir_left), ("infrared_right", frame.ir_right)):
            np.testing.assert_array_equal(
                decoded(row, name), np.repeat(np.asarray(image)[..., None], 3, axis=2)
            )
    assert read[1][IMAGES + "depth"]["path"] == "frame-000001.tiff"
    assert read[1][IMAGES + "depth"]["bytes"][:4] == b"II*\0"


def test_features_hold_units_and_cameras(small_set: Path):
    read = features(exported(small_set))
    info = capture.open_set(small_set).info
    depth = read[IMAGES + "depth"]
    assert (depth["dtype"], depth["shape"]) == ("image", [48, 160, 1])
    assert (depth["info"]["is_depth_map"], depth["info"]["depth_unit"]) == (True, "mm")
    assert depth["info"]["camera_matrix"] == [[90, 0, 79.5], [0, 90, 23.5], [0, 0, 1]]
    right = read[IMAGES + "infrared_right"]
    assert right["shape"] == [48, 160, 3] and right["info"]["is_depth_map"] is False
    assert "depth_unit" not in right["info"]
    assert right["info"]["left_from_camera"][0] == [1, 0, 0, info.baseline_m]
    assert read["timestamp"] == {"dtype": "float32", "shape": [1], "names": None}


def test_finer_depth_is_in_metres_to_the_bit(small_set: Path):
    edit_info(small_set, "depth_unit_m = 0.001", "depth_unit_m = 0.0001")
    out = exported(small_set)
    expected = capture.open_set(small_set).scenes[0].frame(0).depth_m
    depth = decoded(rows(out / FRAMES)[0], "depth")
    assert depth.dtype == np.float32 and (depth == 0).any()
    np.testing.assert_array_equal(np.where(depth > 0, depth, np.nan), expected)
    assert features(out)[IMAGES + "depth"]["info"]["depth_unit"] == "m"
    read = json.loads((out / "meta" / "stats.json").read_text())[IMAGES + "depth"]
    assert read["max"][0][0][0] == pytest.approx(float(depth.max()))


def test_colour_and_aligned_depth_have_their_camera(small_set: Path):
    with (small_set / "capture.toml").open("a") as file:
        file.write("colour_from_left = [[1,0,0,0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n")
        file.write("[colour]\nwidth = 32\nheight = 24\nfx_px = 30\nfy_px = 30\n")
        file.write("cx_px = 15.5\ncy_px = 11.5\n")
    picture = add_colour(small_set)
    add_colour(small_set, "b")
    out = exported(small_set)
    np.testing.assert_array_equal(decoded(rows(out / FRAMES)[0], "rgb"), picture)
    aligned = cv2.imread(str(small_set / "a" / "0" / "depth_colour.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded(rows(out / FRAMES)[0], "rgb_depth"), aligned)
    for name in ("rgb", "rgb_depth"):
        facts = features(out)[IMAGES + name]["info"]
        assert facts["camera_matrix"][0] == [30, 0, 15.5]
        assert facts["left_from_camera"][0][3] == pytest.approx(-0.1)
        assert facts["is_depth_map"] == (name == "rgb_depth")


def test_pictures_of_unknown_cameras_have_none(small_set: Path):
    add_colour(small_set)
    add_colour(small_set, "b")
    assert features(exported(small_set))[IMAGES + "rgb"]["info"] == {"is_depth_map": False}


def test_infrared_of_16_bits_keeps_its_codes(small_set: Path):
    for path in small_set.rglob("ir_*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16) * 9
        cv2.imwrite(str(path), image)
    out = exported(small_set)
    expected = capture.open_set(small_set).scenes[1].frame(0).ir_left
    np.testing.assert_array_equal(decoded(rows(out / FRAMES)[1], "infrared_left"), expected)
    assert features(out)[IMAGES + "infrared_left"]["shape"] == [48, 160, 1]
    read = json.loads((out / "meta" / "stats.json").read_text())[IMAGES + "infrared_left"]
    assert read["max"][0][0][0] > 255


def test_times_give_order_and_rate(small_set: Path):
    set_times(small_set, a=1700000000.5, b=1700000000.4)
    out = exported(small_set)
    read = rows(out / FRAMES)
    first = capture.open_set(small_set).scenes[1].frame(0)
    np.testing.assert_array_equal(decoded(read[0], "infrared_left")[..., 0], first.ir_left)
    assert json.loads((out / "meta" / "info.json").read_text())["fps"] == 10
    assert [row["timestamp"] for row in read] == pytest.approx([0, 0.1])
    assert [row["device_time_s"] for row in read] == pytest.approx([0, 0.1], abs=1e-6)
    assert rows(out / EPISODES)[0]["device_start_s"] == 1700000000.4


def test_frames_without_times_have_thirty_a_second(small_set: Path):
    out = exported(small_set)
    assert json.loads((out / "meta" / "info.json").read_text())["fps"] == 30
    assert [row["timestamp"] for row in rows(out / FRAMES)] == pytest.approx([0, 1 / 30])
    assert "device_time_s" not in features(out)


def test_rooms_are_episodes_and_tasks(small_set: Path, monkeypatch: pytest.MonkeyPatch):
    (small_set / "b" / "room").write_text("hall")
    monkeypatch.setattr(tables, "FILE_MB", 0)  # Each episode begins a file.
    out = exported(small_set)
    episodes = rows(out / EPISODES)
    assert [row["tasks"] for row in episodes] == [["kitchen"], ["hall"]]
    assert [row["data/file_index"] for row in episodes] == [0, 1]
    spans = [(row["dataset_from_index"], row["dataset_to_index"]) for row in episodes]
    assert spans == [(0, 1), (1, 2)]
    (last,) = rows(out / FRAMES.replace("000.parquet", "001.parquet"))
    numbers = ("index", "frame_index", "episode_index", "task_index")
    assert [last[name] for name in numbers] == [1, 0, 1, 1]
    table = parquet.read_table(out / "meta" / "tasks.parquet")
    assert table.to_pydict() == {"task_index": [0, 1], "task": ["kitchen", "hall"]}
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_many_frames_are_written_in_groups(small_set: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tables, "_GROUP_ROWS", 1)
    out = exported(small_set)
    assert parquet.ParquetFile(out / FRAMES).num_row_groups == 2
    assert [row["index"] for row in rows(out / FRAMES)] == [0, 1]


def test_schema_names_the_types_of_images(small_set: Path):
    schema = parquet.read_schema(exported(small_set) / FRAMES)
    kinds = json.loads(schema.metadata[b"huggingface"])["info"]["features"]
    assert kinds[IMAGES + "depth"] == {"_type": "Image"}
    assert kinds["timestamp"] == {"dtype": "float32", "_type": "Value"}


def test_statistics_are_those_of_all_pixels(small_set: Path):
    out = exported(small_set)
    read = json.loads((out / "meta" / "stats.json").read_text())
    scenes = capture.open_set(small_set).scenes
    images = {
        "infrared_left": np.stack([np.asarray(s.frame(0).ir_left) for s in scenes]) / 255,
        "depth": np.stack([np.nan_to_num(s.frame(0).depth_m) * 1000 for s in scenes]),
    }
    for name, pixels in images.items():
        expected = {"min": pixels.min(), "max": pixels.max(), "mean": pixels.mean()}
        expected |= {"std": pixels.std()}
        for share in statistics.QUANTILES:
            lower = np.quantile(pixels, share, method="inverted_cdf")
            expected[f"q{round(100 * share):02d}"] = lower
        table = read[IMAGES + name]
        assert table.pop("count") == [2]
        assert set(table) == set(expected)
        for figure, value in expected.items():
            np.testing.assert_allclose(np.ravel(table[figure]), value, rtol=1e-5, err_msg=figure)
            assert np.shape(table[figure]) == (3 if name == "infrared_left" else 1, 1, 1)
    assert read["index"]["mean"] == [0.5] and read["index"]["count"] == [2]
    (episode,) = rows(out / EPISODES)
    assert episode[f"stats/{IMAGES}depth/mean"] == read[IMAGES + "depth"]["mean"]


def test_streams_of_some_frames_are_left_out(small_set: Path):
    add_colour(small_set)
    (small_set / "b" / "0" / "depth.png").unlink()
    with pytest.warns(UserWarning, match="some frames lack depth, rgb, depth_colour; left out"):
        out = exported(small_set)
    assert {IMAGES + "infrared_left", IMAGES + "infrared_right"} == {
        name for name in features(out) if name.startswith(IMAGES)
    }


def test_sets_without_a_common_image_are_refused(small_set: Path):
    (small_set / "b" / "0" / "depth.png").unlink()
    for name in ("ir_left", "ir_right"):
        (small_set / "a" / "0" / f"{name}.png").unlink()
    with pytest.raises(InputError, match="must have an image that all frames have; got ir_left"):
        exported(small_set)


def test_pictures_of_several_sizes_are_refused(small_set: Path):
    add_colour(small_set)
    add_colour(small_set, "b", (20, 32))
    rule = r"rgb\.png of frame 0 of b must be 32x24 of uint8 as in the first frame; got 32x20"
    with pytest.raises(InputError, match=rule):
        exported(small_set)


def test_sets_of_several_cameras_are_refused(small_set: Path):
    text = (small_set / "capture.toml").read_text()
    (small_set / "b" / "camera.toml").write_text(text.replace("0.05", "0.06"))
    with pytest.raises(InputError, match="captures must be of one camera"):
        exported(small_set)


def test_the_extra_is_named_where_it_is_missing(small_set: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(InputError, match=r"lerobot needs pyarrow; got none\..*\[lerobot\]"):
        exported(small_set)


def test_the_verb_writes_a_data_set(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    command = ["export", str(small_set), "--layout", "lerobot", "--out", str(out)]
    assert command_line.main([*command, "--task", "pick the cup", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 2
    assert rows(out / EPISODES)[0]["tasks"] == ["pick the cup"]
    assert json.loads((out / "starling.json").read_text())["arguments"]["task"] == "pick the cup"
