"""The material library: sources, numbers by hand, and documentation."""

import dataclasses
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.scene import materials

PAGE = Path(__file__).parents[3] / "docs" / "materials.md"


def luminance(name: str) -> float:
    """Visible reflectance with the weights of linear sRGB (ITU-R BT.709)."""
    rgb = materials.named(name).rgb
    assert rgb is not None
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


def test_every_material_is_complete():
    assert len(materials.names()) >= 24
    for name in materials.names():
        entry = materials.entry(name)
        assert entry.material.name == name
        assert entry.source
        if entry.material.kind != "glass":  # A pane has no colour.
            assert entry.material.rgb is not None


def test_names_of_scenes_are_the_librarys():
    """The constants that scenes use are entries of the library."""
    constants = [value for key, value in vars(materials).items() if key.isupper()]
    used = [value for value in constants if isinstance(value, materials.Material)]
    assert len(used) >= 12
    for material in used:
        assert material is materials.named(material.name)


@pytest.mark.parametrize(
    ("name", "by_hand"),
    [
        # ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2)
        ("polished aluminium", 0.8700),  # (2.5217 + 66.7326) / (12.8737 + 66.7326)
        ("brushed steel", 0.5720),  # (3.7947 + 11.9647) / (15.5867 + 11.9647)
        ("copper", 0.9643),  # (0.5242 + 29.3764) / (1.6282 + 29.3764)
        ("glass", 0.04206),  # (0.516 / 2.516)^2
        ("water", 0.01996),  # (0.329 / 2.329)^2
    ],
)
def test_fresnel_by_hand(name, by_hand):
    assert materials.named(name).reflectance == pytest.approx(by_hand, rel=2e-3)


@given(st.floats(0.05, 10), st.floats(0, 20))
def test_a_mirror_gives_no_more_than_it_gets(n, k):
    """Without absorption the reflectance is equal in both directions."""
    assert 0 <= materials.normal_reflectance(n, k) < 1
    inside_out = materials.normal_reflectance(1 / n, 0.0)
    assert inside_out == pytest.approx(materials.normal_reflectance(n, 0.0), abs=1e-12)


def test_black_is_not_black_in_the_infrared_unless_it_is_carbon():
    for name in ("black dyed cloth", "dyed black plastic"):
        assert materials.named(name).reflectance > 2 * luminance(name)
    for name in ("carbon black", "dark plastic", "rubber"):
        assert materials.named(name).reflectance < 0.1
        assert luminance(name) < 0.1


def test_leaves_jump_at_the_red_edge():
    assert materials.named("leaf").reflectance > 4 * luminance("leaf")


@pytest.mark.parametrize(
    ("typo", "nearest"), [("coton", "cotton"), ("pollished alu", "polished aluminium")]
)
def test_unknown_material_names_the_nearest(typo, nearest):
    message = f"material must be a known name; got '{typo}'. Known: {nearest}, "
    with pytest.raises(InputError, match=re.escape(message)):
        materials.named(typo)


@pytest.mark.parametrize(("n", "k", "name"), [(0.0, 1.0, "n must be"), (1.5, -1.0, "k must be")])
def test_impossible_indices_are_refused(n, k, name):
    with pytest.raises(InputError, match=name):
        materials.normal_reflectance(n, k)


def test_entries_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        materials.entry("cotton").source = "mine"  # type: ignore[misc]


def test_page_lists_the_library():
    """Name, kind, reflectance and source in docs/materials.md are those of the code."""
    rows = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 8 and re.fullmatch(r"0\.\d\d", cells[3]):
            rows[cells[0]] = (cells[1], cells[3], cells[7])
    expected = {
        name: (entry.material.kind, f"{entry.material.reflectance:.2f}", entry.source)
        for name, entry in materials.LIBRARY.items()
    }
    assert rows == expected
