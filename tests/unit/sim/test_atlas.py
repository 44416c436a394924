"""The atlas in the documentation agrees with the effect table."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim import effects
from starling.sim.commands import atlas
from starling.sim.effects import Effect, Parameter, Stage, setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import matcher, presets

FOLDER = Path(__file__).parents[3] / "docs" / "effects"
RENEW = "run: starling atlas --out docs/effects --force"
ROWS = effects.table()
ROW = Effect(
    name="soft_focus",
    family="focus",
    stage=Stage.OPTICS,
    parameters=(
        Parameter(name="sigma", paths=("left.a", "b"), unit="px", neutral=0.0, low=0.5, high=2.0),
        Parameter(name="mode", paths=("c",), unit="1", neutral=None, choices=("in", "out")),
    ),
    imitates="A lens.",
    law="s = 2",
    shows="Blur.",
    confused_with=("lens_blur", "gamma"),
    source="Hecht",
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_row_has_a_picture_and_the_generated_page(row: Effect) -> None:
    """The figures below the text come from the drawing. The test cannot detect outdated figures."""
    page = FOLDER / f"{row.name}.md"
    assert page.is_file() and page.read_text().startswith(atlas.effect_text(row)), RENEW
    picture = FOLDER / f"{row.name}.jpg"
    assert picture.is_file() and picture.read_bytes().startswith(b"\xff\xd8\xff"), RENEW


def test_index_lists_all_pages_and_no_others_exist() -> None:
    assert (FOLDER / "index.md").read_text() == atlas.index_page(ROWS), RENEW
    pages = {path.stem for path in FOLDER.glob("*.md")} - {"index"}
    pictures = {path.stem for path in FOLDER.glob("*.jpg")}
    assert pages == pictures == {row.name for row in ROWS}, RENEW


def test_text_contains_all_entries_of_the_row() -> None:
    text = atlas.effect_text(ROW)
    assert text.startswith("# Soft focus\n\nA lens.\n\n![") and text.endswith("|\n")
    assert "(soft_focus.jpg)" in text
    assert "[lens blur](lens_blur.md), [gamma](gamma.md)." in text
    assert "**Law.** s = 2" in text and "**Source.** Hecht" in text
    assert "New render" not in text
    assert "**New render.** a.\n" in atlas.effect_text(dataclasses.replace(ROW, rerender="a"))
    assert "| sigma | `left.a`, `b` | 0 | 0.5 to 2 | px |" in text
    assert "| mode | `c` | as the sensor | in, out | 1 |" in text


def test_page_is_the_text_and_the_figures() -> None:
    figures = {"without": {"no depth [%]": 1.0}, "with": {"no depth [%]": 12.345}}
    page = atlas.effect_page(ROW, 2.0, figures)
    assert page.startswith(atlas.effect_text(ROW))
    assert "Measured on the picture, sigma = 2:" in page
    assert page.endswith("| no depth [%] | 1 | 12.3 |\n")


def test_index_is_sorted_by_stage_without_empty_stages() -> None:
    index = atlas.index_page([ROW])
    assert "## Optics" in index and "## Imager" not in index
    assert "- [soft focus](soft_focus.md) (focus)\n" in index


def test_every_row_is_drawn_with_another_value() -> None:
    base = (presets.load("d435"), scenes.tabletop())
    ideal = setting.ideal(*base)
    for row in ROWS:
        drawing = atlas._drawing(row, ideal, base)
        stands = setting.value(row.parameters[0], *drawing.without)
        assert drawing.affected and stands not in drawing.affected, row.name


def test_sensor_without_the_row_s_field_is_refused() -> None:
    base = (presets.load("d435"), scenes.tabletop())
    quick = (dataclasses.replace(base[0], matcher=matcher.named("fast")), base[1])
    row = effects.named("small_penalty")  # Another engine's, in whole numbers; then one that lacks.
    assert list(atlas._drawing(row, quick, quick).affected) == [row.parameters[0].low]
    for name in ("census_window", "presmooth"):
        with pytest.raises(InputError, match=r"needs a sensor with matcher\.engine"):
            atlas._drawing(effects.named(name), quick, quick)


def test_infrared_crop_has_the_image_s_proportions() -> None:
    image = np.arange(100 * 200, dtype=np.uint16).reshape(100, 200)
    cut = atlas._cropped(image)
    assert cut.shape == (36, 72)
    assert cut[0, 0] == image[40, 84]
