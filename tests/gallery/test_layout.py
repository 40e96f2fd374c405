"""Figures at the widths of a journal's columns: nothing is cut, and no text lies on another."""

import re
import zlib
from io import BytesIO

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import studies
from fivcore import flutter_onsets
from studies import registry, runner
from studies.answering import summary
from studies.answering.results import open_dataset
from studies.asking.sweep import sweep_of
from studies.plotting import compare, figures, moving, receptances
from sweeps import InputError
from tests import HOME
from tests.helpers.layout import faults
from tests.helpers.meshes import structure

WIDTHS = "88mm", "180mm"
REFERENCE = HOME / "results" / "reference"
QUICK = "fig5", "stribeck"


def reference(name):
    return registry.load(name), open_dataset(REFERENCE / name / f"{name}.nc")


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in registry.NAMES]
)
def test_nothing_in_the_figure_of_a_study_is_cut_or_overlaps(name, width):
    for figure in runner.draw(*reference(name), width=width).values():
        assert figure.get_size_inches()[0] == pytest.approx(float(width[:-2]) / 25.4)
        assert figure.get_suptitle().count("\n") < figures.LINES
        assert not faults(figure)


def drawn(name, seed):
    """A function that draws a number, to three digits, between two others."""
    draw = np.random.default_rng([seed, zlib.crc32(name.encode())]).uniform
    return lambda low, high: float(f"{draw(low, high):.3g}")


# Requests of other rigs, grids and scenes, each with draws of a seed of its own.
SHORT = {"duration": 0.1, "record": ["velocity_B"], "sample_rate": 20e3}
DRAWS = {
    "fig5": lambda d: {
        "mu": np.linspace(0.0, d(0.3, 1.0), 41),
        "p2_length": d(0.1, 0.2),
        "p1_length": d(0.04, 0.06),
    },
    "stability": lambda d: {"theta": np.linspace(d(-10.0, 0.0), 20.0, 7), "mu": np.linspace(0.0, d(0.3, 1.0), 6)},
    "sensitivity": lambda d: {"theta": np.linspace(1.0, d(5.0, 15.0), 4), "p1_thickness": d(2e-3, 4e-3)},
    "table4": lambda d: {"theta": d(0.0, 10.0), "contact_position": d(0.07, 0.1)},
    "table6": lambda d: {
        "theta": np.linspace(d(-10.0, 4.0), d(6.0, 20.0), int(d(2, 6))),
        "members": 2,
        "max_duration": 0.4,
        "p1_length": d(0.045, 0.055),
        "mu": d(0.1, 0.3),
    },
    "scenes": lambda d: (
        {"V": [d(1e-3, 9e-3)], "theta": np.sort([d(-5.0, 20.0) for _ in range(int(d(1, 5)))])} | SHORT
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", DRAWS)
def test_nothing_is_cut_or_overlaps_on_drawn_requests(name, seed):
    study, values = registry.load(name), DRAWS[name](drawn(name, seed))
    record = {each: values.pop(each) for each in ("record", "sample_rate") if each in values}
    data = sweep_of(study, values, **record).plan().run("sync")
    for width in WIDTHS:
        for figure in runner.draw(study, data, width=width).values():
            assert not faults(figure), (values, width)


# Maps: along one parameter and over two, of quantities of stability and of motion.
MAPS = {
    "along": lambda d: {"x": f"mu={d(0.0, 0.1)}:{d(0.3, 0.9)}:{int(d(2, 9))}", "quantity": "growth_rate"},
    "several": lambda d: {"x": f"p1_length={d(40, 45)}:{d(50, 70)}:5mm", "quantity": "onset_mu,onset_frequency"},
    "plane": lambda d: {"x": f"theta={d(-9, 0)}:{d(5, 30)}:6", "y": f"mu=0:{d(0.1, 1.0)}:5"},
    "motion": lambda d: {
        "x": f"V=log:1e-3:{d(2e-3, 9e-3)}:3", "y": f"theta={d(1, 3)}:{d(5, 9)}:2",
        "quantity": "regime,velocity_rms",
        "fix": {"min_duration": 0.1, "max_duration": 0.2, "members": 2, "p2_young_modulus": f"{d(150, 250)}GPa"},
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", MAPS)
def test_nothing_is_cut_or_overlaps_on_drawn_maps(name, seed, tmp_path):
    data = studies.map(**MAPS[name](drawn(name, seed)), out=tmp_path, scheduler="sync")
    assert_fits(runner.study_of(data), data)


@pytest.mark.slow
def test_nothing_is_cut_or_overlaps_in_a_fit(tmp_path):
    output = [f"glued_frequency_{k}" for k in (1, 2)]
    targets = [{"output": output, "value": "16.2, 350 Hz", "within": "1%"}]
    unknown = {
        "contact_position": "uniform:70:100mm",
        "head_mass": "loguniform:1:10",
        "p1_length": "normal:50:1mm",
    }
    data = studies.fit({"set": {"theta": 5}, "unknown": unknown, "target": targets, "name": "hammer"},
                       samples=64, rounds=1, out=tmp_path)  # fmt: skip
    assert_fits(runner.study_of(data), data)


def assert_fits(study, data):
    for width in WIDTHS:
        for figure in runner.draw(study, data, width=width).values():
            assert not faults(figure), width


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_cut_or_overlaps_for_structures_and_pairs_of_rigs(seed, width):
    one, other = structure(seed, 20e3), drawn("pair", seed)
    study, onsets = registry.load("fig5"), flutter_onsets(one, 0.0, 10e3, 1.0)
    mu = np.linspace(0.0, other(0.3, 1.0), 21)
    rigs = {"paper": {}, "the one on the new test bench": {"p1_length": other(0.04, 0.06)}}
    pair = {name: sweep_of(study, {"mu": mu} | rig).plan().run("sync") for name, rig in rigs.items()}
    pair = {name: summary.presented(study, data) for name, data in pair.items()}
    with figures.style(width=width):
        assert not faults(receptances.draw(one, 10e3, 1.0, onsets))
        assert not faults(compare.draw(pair, "both: θ = 5°"))


def test_nothing_is_cut_or_overlaps_in_a_film():
    study, data = reference("fig6")
    for moving_one in runner.moving_of(study, data):
        with figures.style(width="88mm"):
            figure, show = moving.draw(moving_one)
            for frame in (0, len(moving_one.moved) // 2):
                show(frame)
                assert not faults(figure)


def test_the_helper_finds_what_is_cut_and_what_overlaps():
    with figures.style(width="88mm"):
        figure, (axes, other) = figures.panels(2, 1, 4.0)
        for x, text in ((0.1, "one"), (0.12, "other")):
            axes.text(x, 0.5, text)
        figure.text(0.95, 0.8, "leaves it", in_layout=False)
        other.plot([0.0, 1.0], [0.0, 1.0], label="curve")
        other.plot([0.02, 1.0], [0.02, 1.0], ".", label="points")
        other.legend(loc="lower left")
        figures.finish(figure)
        assert faults(figure) == [
            "cut: 'leaves it'",
            "'one' on 'other'",
            "legend on the curve 'curve'",
            "legend on the curve 'points'",
        ]
        other.set_title("", loc="left")
        figure.set_size_inches(figure.get_figwidth(), 10.0)
        assert faults(figure)[-2:] == ["no letter: ''", "254 mm high"]


def test_higher_figures_than_a_page_are_lowered():
    with figures.style(width="88mm"):
        figure, _ = figures.panels(5, 1, 7.0)
        assert not faults(figures.finish(figure))


def test_a_long_title_has_two_lines_and_the_rest_below():
    with figures.style(width="88mm"):
        figure, _ = figures.panels(1, 1, 4.0)
        figure.suptitle("A title of many words " * 12)
        figures.finish(figure, "set: F = 9 N", "3 of 4 points failed")
        assert figure.get_suptitle().count("\n") == figures.LINES - 1
        assert figure.get_supxlabel().replace("\n", " ").endswith("set: F = 9 N; 3 of 4 points failed")
        assert not faults(figure)
        bare, _ = figures.panels(1, 1, 4.0)
        bare.suptitle("A title")
        figures.finish(bare, "set: F = 9 N", "3 of 4 points failed", title=False)
    assert (bare.get_suptitle(), bare.get_supxlabel()) == ("", "3 of 4 points failed")
    assert bare.get_label() == "A title\nset: F = 9 N"


def test_fonts_are_embedded_and_text_is_text():
    study, data = reference("table4")
    look = {"width": "88mm", "title": False, "font": "DejaVu Serif"}
    (pdf,), (svg,) = (runner.image(study, data, form, **look).values() for form in ("pdf", "svg"))
    assert b"/Subtype /Type3" not in pdf
    assert b"DejaVuSerif" in pdf
    assert b"deviation / %" in svg
    assert b"DejaVu Serif" in svg
    assert float(re.search(rb'width="([\d.]+)pt"', svg)[1]) == pytest.approx(88.0 / 25.4 * 72.0)


def test_a_style_and_the_users_settings_are_obeyed(tmp_path, monkeypatch):
    sheet = tmp_path / "own.mplstyle"
    sheet.write_text("lines.linewidth: 3\nfont.size: 6\n", encoding="utf-8")
    (tmp_path / "matplotlibrc").write_text(
        "backend: agg\naxes.grid: False\nlines.linewidth: 5\n", encoding="utf-8"
    )
    monkeypatch.setenv("MATPLOTLIBRC", str(tmp_path))
    from matplotlib import rcParams

    plain = figures.look_digest()
    with figures.style(width="88mm", sheet=sheet):
        assert (rcParams["lines.linewidth"], rcParams["font.size"], rcParams["axes.grid"]) == (3.0, 6.0, False)
        assert figures.look_digest() != plain
    with figures.style(width="88mm"):
        assert (rcParams["lines.linewidth"], rcParams["font.size"]) == (5.0, figures.SMALL)


@pytest.mark.parametrize("sheet", ["dark_background", "ggplot", "own"])
def test_styles_of_others_are_read_and_nothing_is_cut_or_overlaps(sheet, tmp_path):
    (tmp_path / "own.mplstyle").write_text(
        "figure.autolayout: True\nfont.family: serif\nfont.size: 7\nxtick.direction: in\nytick.direction: in\n"
        "lines.markeredgewidth: 0\nsavefig.bbox: tight\nsavefig.dpi: 600\ntext.usetex: True\n",
        encoding="utf-8",
    )
    study, data = reference("fig5")
    look = {"width": "88mm", "sheet": tmp_path / "own.mplstyle" if sheet == "own" else sheet}
    figure = runner.draw(study, data, **look)[""]
    assert not faults(figure)
    back = to_rgb(figure.axes[0].get_facecolor())
    lines = [line for axes in figure.axes for line in axes.lines if line.get_linestyle() != "None"]
    assert all(np.abs(np.subtract(to_rgb(line.get_color()), back)).sum() > 0.5 for line in lines)
    assert all(line.get_markeredgewidth() > 0.0 for axes in figure.axes for line in axes.lines)
    with Image.open(BytesIO(runner.image(study, data, **look)[""])) as image:
        assert image.width == pytest.approx(88.0 / 25.4 * figure.dpi, abs=2)


@pytest.mark.parametrize(
    ("look", "message"),
    [
        ({"width": "88m"}, "width = 88m: it must be from 40mm to 1000mm"),
        ({"font": "DejaVu Serf"}, "font = 'DejaVu Serf': there is no such font here; did you mean DejaVu Serif"),
        ({"sheet": "nature"}, "style = 'nature': it must be a style file or one of"),
    ],
)
def test_what_cannot_be_is_refused(look, message):
    with pytest.raises(InputError, match=re.escape(message)), figures.style(**look):
        pass
