"""Figures at the widths of a journal's columns: nothing is cut, and no text lies on another."""

import re
import zlib

import numpy as np
import pytest

from studies import registry, runner
from studies.answering.results import open_dataset
from studies.asking.sweep import sweep_of
from studies.plotting import figures
from sweeps import InputError
from tests import HOME
from tests.helpers.layout import faults

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
    "scenes": lambda d: (
        {"V": [d(1e-3, 9e-3)], "theta": np.sort([d(-5.0, 20.0) for _ in range(int(d(1, 5)))])} | SHORT
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", DRAWS)
def test_nothing_is_cut_or_overlaps_on_drawn_requests(name, seed):
    study, draw = registry.load(name), np.random.default_rng([seed, zlib.crc32(name.encode())]).uniform
    values = DRAWS[name](lambda low, high: float(f"{draw(low, high):.3g}"))
    record = {each: values.pop(each) for each in ("record", "sample_rate") if each in values}
    data = sweep_of(study, values, **record).plan().run("sync")
    for width in WIDTHS:
        for figure in runner.draw(study, data, width=width).values():
            assert not faults(figure), (values, width)


def test_the_helper_finds_what_is_cut_and_what_overlaps():
    with figures.style(width="88mm"):
        figure, (axes,) = figures.panels(1, 1, 4.0)
        for x, text in ((0.1, "one"), (0.12, "other")):
            axes.text(x, 0.5, text)
        figure.text(0.95, 0.5, "leaves it", in_layout=False)
        found = faults(figures.finish(figure))
    assert found == ["cut: 'leaves it'", "'one' on 'other'"]


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
