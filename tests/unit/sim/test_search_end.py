"""Warning of a nearest depth that the search does not reach."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from starling.sim.sensor import edits, presets, search_end

D435 = presets.load("d435")


def messages(folder: Path, text: str, mode: str = "") -> list[str]:
    path = folder / "mine.toml"
    path.write_text(f'base = "d435"\n{text}')
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        presets.load(str(path), mode=mode)
    return [str(each.message) for each in caught]


@pytest.mark.parametrize("name", presets.names())
def test_no_preset_warns_in_any_mode(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for mode in ("", *presets.load_file(name).modes):
            search_end.warn(presets.load(name, mode=mode), name)


def test_the_warning_names_both_ends_and_what_to_set(tmp_path: Path) -> None:
    """f b is 21.6 px m: the search of 128 ends at 126 px, that of 224 at 222 px."""
    (text,) = messages(tmp_path, "post.near_m = 0.1\n")
    assert text == (
        f"{tmp_path / 'mine.toml'}: post.near_m is 0.1 m, and the search of 128 disparities ends "
        "at 0.171 m. Depth of nearer surfaces is missing or wrong. Set post.near_m to 0.171, or "
        "matcher.search_px to 224."
    )
    assert messages(tmp_path, "post.near_m = 0.1\nmatcher.search_px = 224\n") == []
    assert len(messages(tmp_path, "post.near_m = 0.1\nmatcher.search_px = 192\n")) == 1
    assert len(messages(tmp_path, "matcher.search_px = 64\n")) == 1


@pytest.mark.parametrize(("near_m", "count"), [(0.0, 0), (0.164, 0), (0.162, 1), (0.3, 0)])
def test_rounded_and_missing_ends_give_no_warning(
    tmp_path: Path, near_m: float, count: int
) -> None:
    assert len(messages(tmp_path, f"post.near_m = {near_m}\n")) == count


@pytest.mark.parametrize("mode", ["1280x720", "424x240"])
def test_modes_move_both_ends(tmp_path: Path, mode: str) -> None:
    assert messages(tmp_path, "post.near_m = 0.17\n", mode) == []
    assert len(messages(tmp_path, "post.near_m = 0.1\n", mode)) == 1


@pytest.mark.parametrize(
    "changes",
    [
        [("post.near_m", 0.05)],  # It needs more than the longest search.
        [("post.near_m", 0.05), ("matcher.extended", True), ("matcher.min_disparity_px", 8)],
    ],
)
def test_a_search_that_does_not_exist_is_not_advised(changes: list[tuple[str, float]]) -> None:
    sensor = edits.with_values(D435, changes)
    assert search_end.end_m(sensor) == pytest.approx(
        sensor.focal_baseline_px_m / (sensor.matcher.largest_px - 1)
    )
    with pytest.warns(UserWarning, match=r"Set post\.near_m to 0\.\d+\.$"):
        search_end.warn(sensor, "mine.toml")
