"""The report of a small synthetic calibration: figures, page and pictures."""

from __future__ import annotations

import dataclasses
import json
import re
from html.parser import HTMLParser
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration.fit_sensor import Calibration
from starling.calibration.heldout import SceneScore
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.report import figures
from starling.calibration.report import page as report_page
from starling.calibration.report import pictures as report_pictures
from starling.calibration.solution import Estimate, Solution
from starling.sim.console import record
from starling.sim.report.elements import MINUS
from starling.sim.sensor import presets

SHAPE = (108, 192)
OPEN = "Focal length and baseline cannot be told apart: capture a posed mesh <1 m away & move it."
WARNED = "right image of room <b>a</b> is darker than the left one"
KEYS = {"parameters", "derived", "undetermined", "warnings", "heldout", "scenes", "rooms"}
SCORES = {"ncc", "ncc_p25", "ceiling", "ceiling_p25", "mirrored"}


def _dots(seed: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Return random dots on a smooth background (h, w) [DN]."""
    random = np.random.default_rng(seed)
    points = (random.random(shape) < 0.02).astype(np.float32)
    shade = np.linspace(40, 90, shape[1], dtype=np.float32)[None]
    return shade * (1 + 6 * cv2.GaussianBlur(points, (0, 0), 1.1))


def scored(
    name: str, *, noise: float, shape: tuple[int, int] = SHAPE, ncc: float = 0.9
) -> SceneScore:
    random = np.random.default_rng(len(name))
    real = {"left": _dots(1, shape), "right": _dots(2, shape)}
    simulated = {
        side: image + noise * random.standard_normal(shape).astype(np.float32)
        for side, image in real.items()
    }
    windows = np.array([ncc - 0.2, ncc, ncc + 0.02], np.float32)
    return SceneScore(
        scene=name,
        room=f"room of {name}",
        scale=1.001,
        real=real,  # pyright: ignore[reportArgumentType]
        simulated=simulated,  # pyright: ignore[reportArgumentType]
        ncc={"left": windows, "right": windows - np.float32(0.01)},
        mirrored={"left": windows * 0, "right": windows * 0},
        ceiling=np.array([0.9, 0.96, 0.97], np.float32),
    )


def recovered() -> RecoveredPattern:
    grid = Grid(half_a=0.3, half_b=0.2, step=0.004)
    sd = np.full(grid.shape, 0.2, np.float32)
    sd[:, : grid.shape[1] // 4] = np.inf
    image = PatternImage(
        grid=grid,
        value=_dots(3, grid.shape) / 90,
        sd=sd,
        views=np.where(np.isfinite(sd), 3, 0).astype(np.float32),
    )
    lattice = Lattice(frequencies=np.array([[60.0, 0], [20.0, 55.0]]), phase=np.zeros(2))
    emitters = tuple(
        PatternEmitter(position_m=np.array([x, 0.001, -0.002]), source=lattice)
        for x in (0.026, 0.029)
    )
    model = EmitterModel(emitters=emitters, rotation_deg=(0, 0.5, 0), scales={"desk": 1.0})
    covariance = np.eye(len(model.names)) * (25e-6) ** 2
    fitted = PatternFit(
        model=model, covariance=covariance, cost=(2.0, 1.1), shares=np.array([0.6, 0.4])
    )
    return RecoveredPattern(fitted=fitted, image=image)


def calibration(**changes: Any) -> Calibration:
    """Return a complete calibration, with names and sentences that need HTML escaping."""
    inf = float("inf")
    estimates = (
        Estimate(name="baseline_m", value=0.0550131, sd=21e-6, unit="m", start=0.053),
        Estimate(name="fx_px", value=640.123, sd=inf, unit="px", start=636.0),
        Estimate(name="projector.rotation_deg.y", value=-0.4321, sd=0.0087, unit="deg", start=0),
        Estimate(name="pattern_scale[a<b>]", value=1.0012, sd=4e-5, unit="1", start=1.0),
    )
    covariance = np.diag([estimate.sd**2 for estimate in estimates])
    covariance[0, 2] = covariance[2, 0] = -0.97 * 21e-6 * 0.0087
    geometry = Solution(
        estimates=estimates,
        covariance=covariance,
        undetermined=(OPEN,),
        cost=(3.5, 1.4, 1.05),
        sensor=presets.load("d415"),
        derived=(Estimate(name="focal_baseline", value=35.2, sd=0.01, unit="px m", start=34.0),),
    )
    photometry = dataclasses.replace(
        geometry,
        estimates=(Estimate(name="projector.power_w", value=0.1, sd=0.01, unit="W", start=0.2),),
        covariance=np.array([[1e-4]]),
        undetermined=(),
        cost=(),
        derived=(),
        scenes={"a<b>": {"ambient_w_m2": 0.3}},
    )
    whole = Calibration(
        sensor=dataclasses.replace(presets.load("d415"), name="my <d415>"),
        solutions={"geometry": geometry, "photometry": photometry},
        warnings=(WARNED,),
        fitted_rooms=("room <1>", "hall"),
        heldout=(scored("desk", noise=2, ncc=0.8), scored("shelf <x>", noise=9, ncc=0.6)),
        before=(scored("desk", noise=30, ncc=0.3),),
        recovered=recovered(),
        seconds={"geometry": 12.5, "held-out": 3.0},
    )
    return dataclasses.replace(whole, **changes)


BARE = {"solutions": {}, "warnings": (), "heldout": (), "before": (), "recovered": None}


def test_figures_have_the_specified_keys() -> None:
    values = figures.calibration_figures(calibration())
    assert set(values) == {*KEYS, "seconds", "stages"}
    assert set(values["parameters"]["baseline_m"]) == {"value", "sd", "unit", "start"}
    assert set(values["derived"]["focal_baseline"]) == {"value", "sd", "unit", "start"}
    assert set(values["heldout"]) == {*SCORES, "before", "scenes"}
    scene = values["heldout"]["scenes"]["desk"]
    assert set(scene) == {*SCORES, "room", "pattern_scale", "left", "right", "before"}
    assert set(scene["left"]) == set(scene["right"]) == {"ncc", "ncc_p25"}
    assert set(scene["before"]) == {"ncc", "ncc_p25", "left", "right"}
    assert values["scenes"] == {"a<b>": {"pattern_scale": 1.0012, "ambient_w_m2": 0.3}}
    assert values["undetermined"] == [OPEN] and values["warnings"] == [WARNED]
    assert values["rooms"] == ["room <1>", "hall"]
    assert values["seconds"] == 15.5


def test_missing_figures_are_null_in_json() -> None:
    """Infinite deviations and missing scores become null."""
    values = json.loads(record.dumps(figures.calibration_figures(calibration())))
    assert values["parameters"]["fx_px"]["sd"] is None
    assert values["heldout"]["scenes"]["shelf <x>"]["before"]["ncc"] is None
    bare = json.loads(record.dumps(figures.calibration_figures(calibration(**BARE))))
    assert set(bare) == {*KEYS, "seconds", "stages"}
    assert all(bare["heldout"][name] is None for name in SCORES)
    assert bare["heldout"]["scenes"] == {} == bare["parameters"]


def test_heldout_scores_pool_the_imagers_and_take_the_median_scene() -> None:
    """Pooled windows 0.1 ... 0.5 have median 0.3 and quartile 0.2; scenes are 0.3, 0.5, 0.9."""
    left, right = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.5])
    first = dataclasses.replace(
        scored("one", noise=1),
        ncc={"left": left.astype(np.float32), "right": right.astype(np.float32)},
    )
    alone = [
        dataclasses.replace(
            scored(name, noise=1),
            ncc={"left": np.full(3, value, np.float32)},
            ceiling=np.empty(0, np.float32),
        )
        for name, value in (("two", 0.5), ("three", 0.9))
    ]
    values = figures.heldout_figures(calibration(heldout=(first, *alone), before=()))
    scenes = values["scenes"]
    assert scenes["one"]["ncc"] == pytest.approx(0.3)
    assert scenes["one"]["ncc_p25"] == pytest.approx(0.2)
    assert scenes["one"]["left"]["ncc"] == pytest.approx(0.25)
    assert np.isnan(scenes["two"]["right"]["ncc"]) and np.isnan(scenes["two"]["ceiling"])
    assert values["ncc"] == pytest.approx(0.5)
    assert values["ncc_p25"] == pytest.approx(0.5)
    assert values["ceiling"] == pytest.approx(0.96)  # Only one scene has it.
    assert np.isnan(values["before"]["ncc"])


class _Balance(HTMLParser):
    """Collect unbalanced tags and all sources."""

    VOID = ("meta", "img", "br", "hr", "link", "input")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.words: list[str] = []
        self.sources: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        named = dict(attrs)
        self.sources += [named[key] or "" for key in ("src", "href") if key in named]
        self.ids += [named["id"] or ""] if "id" in named else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def _parsed(page: str) -> _Balance:
    parser = _Balance()
    parser.feed(page)
    parser.close()
    return parser


@pytest.mark.parametrize("changes", [{}, BARE, {"before": ()}, {"seconds": {}}])
def test_page_is_valid_and_self_contained(changes: dict[str, Any]) -> None:
    page = report_page.page(calibration(**changes))
    parsed = _parsed(page)
    assert not parsed.open and not parsed.wrong
    anchors = {f"#{name}" for name in parsed.ids}
    assert all(
        source.startswith("data:image/png") or source in anchors for source in parsed.sources
    )
    assert len(parsed.ids) == len(set(parsed.ids))
    assert not parsed.tags & {"script", "link", "iframe"}
    assert not re.search(r"https?:|@import|url\(", page)
    assert "nan" not in re.findall(r"\w+", "".join(parsed.words).lower())


def test_page_has_all_parameters_and_sentences() -> None:
    """The parsed text contains all names and sentences, and none of them became a tag."""
    case = calibration()
    parsed = _parsed(report_page.page(case))
    words = "".join(parsed.words)
    for estimate in (*case.estimates, *case.solutions["geometry"].derived):
        assert estimate.name in words
    for text in (OPEN, WARNED, "my <d415>", "room <1>", "shelf <x>", "room of shelf <x>"):
        assert text in words
    assert not parsed.tags & {"d415", "x", "1"}


def test_page_shows_pictures_of_each_imager_before_and_after() -> None:
    """Each imager has four pictures, two residuals, and two more with a score before the fit.

    The pattern has four pictures and two colour bars.
    """
    sources = _parsed(report_page.page(calibration())).sources
    pictures = [source for source in sources if source.startswith("data:")]
    assert len(pictures) == 2 * (4 + 2) + 2 * (4 + 4) + 4 + 2
    bare = _parsed(report_page.page(calibration(**BARE)))
    assert not any(source.startswith("data:") for source in bare.sources)
    assert "No scene was held out" in "".join(bare.words)


def test_no_more_than_three_scenes_are_pictured() -> None:
    many = tuple(scored(f"scene {i}", noise=1, ncc=0.5 + 0.05 * i) for i in range(6))
    headings = re.findall(r"the (\w+) of those held", report_page.page(calibration(heldout=many)))
    assert headings == ["best", "median", "worst"]


def test_strong_correlations_are_listed() -> None:
    text = report_page.strongest(calibration().solutions["geometry"])
    assert "baseline_m" in text and "projector.rotation_deg.y" in text
    assert f"{MINUS}0.970" in text
    assert "fx_px" not in text  # Unidentifiable, so without correlation.


def test_unidentifiable_parameters_have_no_deviation() -> None:
    cells = report_page.estimates_table(calibration().solutions["geometry"].estimates)
    assert cells.count("unidentifiable") == 1
    assert ">0.055013<" in cells and ">0.000021<" in cells and ">+95.9 std<" in cells


@given(st.floats(1e-9, 1e6), st.floats(-1e3, 1e3))
def test_deviations_show_two_digits(sd: float, value: float) -> None:
    """Rounding to two digits changes a deviation by at most 5 %."""
    estimate = Estimate(name="n", value=value, sd=sd, unit="1", start=0.0)
    cells = re.findall(r'<td class="number">([^<]*)</td>', report_page.estimates_table([estimate]))
    shown_value, shown_sd = (float(cell.replace(MINUS, "-")) for cell in cells[:2])
    assert shown_sd == pytest.approx(sd, rel=0.0501)
    assert shown_value == pytest.approx(value, abs=max(0.0501 * sd, 0.5 if sd > 9.9 else 0))


def _decoded(picture: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def test_residual_ignores_gain_and_offset() -> None:
    """An affine copy gives a grey residual; different dots leave most of the variance."""
    case = scored("desk", noise=0)
    affine = dataclasses.replace(
        case, simulated={side: 10 + 3 * image for side, image in case.simulated.items()}
    )
    different = dataclasses.replace(case, simulated={"left": _dots(7), "right": _dots(8)})
    same = report_pictures.draw_imager(affine, different, "left")
    assert same.residual.unexplained < 1e-3
    assert np.abs(_decoded(same.residual.whole).astype(int) - 128).max() <= 4
    assert same.before is not None and same.before.unexplained > 0.9
    assert _decoded(same.before.whole).std() > 30
    assert np.array_equal(_decoded(same.real), _decoded(same.simulated))


def test_pictures_are_of_the_sizes_that_fit_a_page() -> None:
    drawn = report_pictures.draw_imager(scored("big", noise=3, shape=(720, 1280)), None, "right")
    assert _decoded(drawn.real).shape == _decoded(drawn.simulated).shape == (360, 640)
    assert (drawn.crop.height, drawn.crop.width) == (120, 213)
    assert _decoded(drawn.real_zoomed).shape == (360, 639)
    assert _decoded(drawn.residual.zoomed).shape == (360, 639)
    assert drawn.before is None


def test_the_crop_is_neither_the_best_nor_the_worst() -> None:
    """Of an equal, a noisy and a different third, the noisy one has the median correlation."""
    shape = (360, 3 * 213)
    real, second = _dots(1, shape), _dots(2, shape)
    simulated = real.copy()
    random = np.random.default_rng(0)
    simulated[:, 213:426] += 8 * random.standard_normal((360, 213)).astype(np.float32)
    simulated[:, 426:] = second[:, 426:]
    case = dataclasses.replace(
        scored("thirds", noise=0), real={"left": real}, simulated={"left": simulated}
    )
    drawn = report_pictures.draw_imager(case, None, "left")
    assert drawn.crop.left == 213
    assert 0.2 < drawn.crop_ncc < 0.95


def test_flat_images_make_pictures_too() -> None:
    flat = np.zeros(SHAPE, np.float32)
    case = dataclasses.replace(
        scored("dark", noise=0), real={"left": flat}, simulated={"left": flat}
    )
    drawn = report_pictures.draw_imager(case, case, "left")
    assert drawn.residual.unexplained == 0
    assert drawn.crop_ncc == 0


def test_pattern_marks_uncovered_directions() -> None:
    case = recovered().image
    drawn = report_pictures.draw_pattern(case)
    unseen = ~np.isfinite(case.sd)
    for picture in (drawn.value, drawn.coverage, drawn.sd):
        shown = _decoded(picture)[..., ::-1]
        marked = (shown == np.array(report_pictures.UNKNOWN)).all(axis=-1)
        assert np.array_equal(marked, unseen)
    enlarged = (_decoded(drawn.zoomed)[..., ::-1] == report_pictures.UNKNOWN).all(axis=-1)
    assert np.array_equal(enlarged, unseen.repeat(3, axis=0).repeat(3, axis=1))
    assert drawn.most_views == 3
    assert drawn.sd_limits == pytest.approx((0.2, 0.2))


def test_a_pattern_without_coverage_is_unknown() -> None:
    case = recovered()
    unseen = dataclasses.replace(
        case.image,
        sd=np.full(case.image.grid.shape, np.inf, np.float32),
        views=np.zeros(case.image.grid.shape, np.float32),
    )
    page = report_page.page(
        calibration(recovered=dataclasses.replace(case, image=unseen), heldout=())
    )
    assert "0.0% of the directions" in page


def test_a_pattern_without_a_lattice_is_reported_as_an_image() -> None:
    case = recovered()
    emitter = PatternEmitter(position_m=np.array([0.027, 0, 0]), source=case.image)
    model = dataclasses.replace(case.fitted.model, emitters=(emitter,))
    fitted = dataclasses.replace(
        case.fitted, model=model, covariance=np.eye(len(model.names)), shares=np.ones(1)
    )
    page = report_page.page(calibration(recovered=dataclasses.replace(case, fitted=fitted)))
    assert "No dot lattice stands out" in page and "an image" in page
    assert "2 lattices of dots" in report_page.page(calibration())
