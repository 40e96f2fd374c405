"""Every study, in one table: same bits in any batch, summaries, claims, and figures on any request."""

import warnings
from itertools import combinations

import numpy as np
import pytest
import xarray as xr

from studies import paper, registry, runner
from studies.accuracy.study import COSTS
from studies.answering import claims, reference, summary
from studies.asking.sweep import sweep_of
from studies.plotting import figures
from sweeps.storage.assemble import rounded
from sweeps.task import Task, one_blas_thread
from tests import HOME, make_reference

KEPT = HOME / "results" / "reference"
# Those that take long as they are.
ENSEMBLE = {"members": 2, "max_duration": 0.6, "min_duration": 0.2}
SCENE = {"mu": 0.2, "F": 9.0}
SMALL = {
    "fig7": {"duration": 0.3},
    "contact": {"duration": 0.3, "window_start": 0.2, "overview": 0.25, "most": 0},
    "fig11": {"duration": 0.2},
    "table6": {"theta": [-5.0, 5.0, 15.0]} | ENSEMBLE,
    "stick_time": {"V": [1e-3, 2e-3], "member": [1, 2], "min_duration": 0.3} | SCENE,
    "stability": {"theta": [-5.0, 5.0, 15.0], "mu": [0.0, 0.2, 0.4]},
    "sensitivity": {"theta": [-5.0, 5.0, 9.0]},
    "robust": {"theta": [0.0, 5.0, 9.0], "samples": 64, "sobol_samples": 16},
    "regimes": {"V": [1e-3, 5e-3], "mu": [0.05, 0.2]} | ENSEMBLE,
    "damping": {"d1": [50.0], "d2": [1e-8, 2e-7], "members": 2, "duration": 0.2},
    "stribeck": {"V": [1e-3, 4e-3], "kinetic_ratio": [0.8, 1.0]} | ENSEMBLE,
    "hysteresis": {"mu": [0.1, 0.12], "hold": 0.1, "member": [1, 2]},
    "cycles": {"d2": [1e-6], "mu": [0.116, 0.118], "hold": 0.1, "edges": 1, "most": 4},
    "basins": {"mu": [0.09, 0.1, 0.115], "most": 20, "duration": 0.2},
    "scenes": {"V": [2e-3, 5e-3], "duration": 0.1} | SCENE,
    "accuracy": {"method": "fast", "setting": ["default", "cut-off 0.4"], "scene": "5 mm/s", "members": 2}
    | {"duration": 0.25},
    "stress": {"case": ["theta = 90°", "3 and 3 elements"]},
    "patch": {"nodes": [1, 3], "mu": [0.1, 0.4], "finer": 1, "members": 2, "min_duration": 0.1}
    | {"max_duration": 0.2},
}


LONG = (
    *("accuracy", "stress", "classics", "damping", "basins", "stick_time", "robust", "hysteresis", "cycles"),
    "patch",
)


@pytest.fixture(scope="module")
def small():
    """Each study's small result, computed once, with the points and values of its batches."""
    kept = {}

    def of(name):
        if name not in kept:
            batches, call = [], Task._call

            def watched(self, points):
                found = call(self, points)
                batches.append((points, found[0]))
                return found

            with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
                warnings.simplefilter("error")
                patch.setattr(Task, "_call", watched)
                sweep = sweep_of(registry.load(name), SMALL.get(name, {}))
                kept[name] = sweep, sweep.plan().run("sync"), batches
        return kept[name]

    return of


@pytest.mark.parametrize("name", registry.NAMES)
def test_a_point_has_the_same_bits_in_any_batch(name, small):
    sweep, data, batches = small(name)
    assert np.all(data["status"] == 1)
    points, values = (
        {key: np.concatenate([batch[part][key] for batch in batches]) for key in batches[0][part]}
        for part in (0, 1)
    )
    count, rng = len(points[next(iter(points))]), np.random.default_rng(0)
    # Alone, and with another, where a point is no long motion.
    for size in (1,) if name in LONG else (1, 3):
        chosen = np.sort(rng.choice(count, min(size, count), replace=False))
        with one_blas_thread():
            found = sweep.function({axis: column[chosen] for axis, column in points.items()}, **sweep.constants)
        # The cost of a run is measured anew each time.
        for key in set(sweep.variables) - set(COSTS):
            variable, whole = sweep.variables[key], values[key][chosen]
            alone = rounded(np.asarray(found[key]).astype(variable.dtype), variable.digits)
            np.testing.assert_array_equal(alone, whole, key)


@pytest.mark.parametrize("name", registry.NAMES)
def test_a_summary_fits_the_terminal_and_begins_with_a_sentence(name, small):
    study, (_, data, _) = registry.load(name), small(name)
    parts = list(summary.parts(study, data))
    assert all(isinstance(part, str) for part in parts[:2])
    assert study.summary is not None
    for width in (80, 120):
        text = summary.text(parts, width)
        assert max(map(len, text.splitlines())) <= width
    assert "Traceback" not in text
    for caption, table in (part for part in parts if not isinstance(part, str)):
        assert caption
        assert "<script" not in summary.html(table.head(1).map(lambda _: "<script>"))


def test_the_claims_of_the_paper_stand_beside_its_own_rig_only():
    """Every claim of the gallery is answered by the reference, with the paper's number."""
    for name in registry.NAMES:
        study = registry.load(name)
        with xr.open_dataset(KEPT / name / f"{name}.nc") as data:
            table = claims.beside(data, study.claims)
            assert len(table) == len(study.claims), name
            assert set(table["deviation"]) <= {"none", "differs", "-"} | {
                d for d in table["deviation"] if "%" in d
            }
            other = data.assign_attrs(configuration=data.attrs["configuration"].replace("2.9434", "2.0"))
            assert not len(claims.beside(other, study.claims)), name
    for name in make_reference.TWICE:
        with xr.open_dataset(KEPT / make_reference.IDENTIFIED / name / f"{name}.nc") as data:
            assert len(claims.beside(data, registry.load(name).claims)) == len(registry.load(name).claims), name
    assert (
        claims.Claim("onset_mu", {"onset": 1}, paper.ONSETS[0][0], "3.4.2, steps of 0.01")
        in registry.load("fig5").claims
    )


def drawn(study, data):
    """The study's figures, laid out; any warning is an error."""
    with warnings.catch_warnings(), figures.style():
        warnings.simplefilter("error")
        found = runner.draw(study, data)
        for figure in found.values():
            figure.draw_without_rendering()
            figure.draw_without_rendering()  # as a saved figure
    return found


def boxes(axes):
    """Extents of the tick labels of each side of a panel."""
    for side in (axes.xaxis, axes.yaxis):
        low, high = sorted(side.get_view_interval())
        ticks = [tick for tick in side.get_major_ticks() if low <= tick.get_loc() <= high]
        texts = [tick.label1 for tick in ticks if tick.label1.get_visible() and tick.label1.get_text()]
        yield [text.get_window_extent() for text in texts]


def check_layout(figure):
    """Nothing is clipped, tick labels and titles do not overlap, legends name each thing once."""
    whole = figure.bbox.padded(2.0)
    texts = [
        text for axes in figure.axes for text in (axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label)
    ]
    texts = [
        text for text in texts if text.get_text() and text.get_visible() and getattr(text.axes, "axison", True)
    ]
    for text in [*texts, *([figure._suptitle] if figure._suptitle else [])]:
        box = text.get_window_extent()
        inside = whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
        assert inside, text.get_text()
    for axes in figure.axes:
        for group in boxes(axes):
            assert not any(one.overlaps(other) for one, other in combinations(group, 2)), axes.get_title("left")
    for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]:
        names, box = [text.get_text() for text in legend.get_texts()], legend.get_window_extent()
        assert len(set(names)) == len(names)
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1, names


@pytest.mark.parametrize(
    ("rig", "told"),
    [({}, ""), ({"p1_length": 0.06}, " (P1 length = 60 mm)"), ({"d1": 1.0, "d2": 0.0}, " (not the paper's rig)")],
)
def test_a_title_names_the_one_number_that_is_not_the_papers(rig, told):
    data = sweep_of(registry.load("fig5"), {"mu": [0.1, 0.2]} | rig).plan().run("sync")
    assert drawn(registry.load("fig5"), data)[""]._suptitle.get_text().endswith(f"sliding{told}")


def test_modes_fill_their_panel():
    study = registry.load("fig5")
    data = sweep_of(study, {"mu": [0.1, 0.2]}).plan().run("sync")
    low = data.assign(frequency=0.25 * data["frequency"])
    top = drawn(study, low)[""].axes[0].get_ylim()[1]
    assert top == pytest.approx(1.3e-3 * float(low["frequency"].max()))


def test_a_result_with_fewer_realisations_is_not_compared_and_says_why():
    with xr.open_dataset(KEPT / "hysteresis" / "hysteresis.nc") as data:
        text = reference.compared(registry.load("hysteresis"), data.isel(member=[0]), data)
    count = data.sizes["member"]
    assert text == f"not compared with the reference: it has {count} realisations, this result has 1"


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.NAMES)
def test_the_reference_is_drawn_without_overlap(name):
    with xr.open_dataset(KEPT / name / f"{name}.nc") as data:
        for figure in drawn(registry.load(name), data.load()).values():
            check_layout(figure)


# Between them every kind of figure: lines and modes, series, a plane of regimes, distributions.
VARIED = ("contact", "regimes")
REQUESTS = [
    pytest.param(name, range(first, last), id=f"{name}-{first}", marks=[pytest.mark.slow] * slow)
    for name in registry.NAMES
    for first, last, slow in ((0, 2, name not in VARIED), (2, 20, True))
]


@pytest.mark.parametrize(("name", "requests"), REQUESTS)
def test_figures_hold_on_twenty_drawn_requests(name, requests):
    """One point, all failed, all without values, a long title, few points: parts of the reference are drawn."""
    study = registry.load(name)
    with xr.open_dataset(KEPT / name / f"{name}.nc") as file:
        data = file.load()
    dims = [str(dim) for dim in data["status"].dims]
    for k in requests:
        rng = np.random.default_rng((k, *map(ord, name)))
        counts = {dim: 1 if k == 0 else min(data.sizes[dim], int(rng.integers(1, 6))) for dim in dims}
        part = data.isel({dim: np.sort(rng.choice(data.sizes[dim], n, False)) for dim, n in counts.items()})
        if "member" in part.dims and "member" not in dims:
            part = part.isel(member=slice(int(rng.integers(1, 3))))
        if k in (1, 2):
            part = part.copy(deep=True)
            part["status"][:] = 2 if k == 1 else 1
            for variable in part.data_vars:
                if part[variable].dtype.kind == "f" and set(dims) & set(part[variable].dims):
                    part[variable] = part[variable] * np.nan
        if k == 3:
            part = part.assign_attrs(title="A long title " * 12)
        for figure in drawn(study, part).values():
            check_layout(figure)
        assert summary.text(summary.parts(study, part), 100)


@pytest.mark.parametrize(
    "form", [pytest.param(each, marks=[pytest.mark.slow] * (each == "pdf")) for each in runner.FORMATS]
)
def test_a_figure_has_the_same_bytes_each_time(form):
    import matplotlib

    study = registry.load("table4")
    data = sweep_of(study).plan().run("sync")
    first = runner.image(study, data, form)[""]
    with matplotlib.rc_context({"axes.facecolor": "black", "savefig.transparent": True}):
        assert runner.image(study, data, form)[""] == first
    assert first.lstrip()[:5] == {"png": b"\x89PNG\r", "svg": b"<?xml", "pdf": b"%PDF-"}[form]


# Differences of nearly equal values, which are compared themselves; and places of an extremum, which are known to
# the square root of its rounding.
IN_ROUNDING = {("classics", "difference"), ("stress", "value"), ("stress", "bound"), ("stress", "margin")}
IN_ROUNDING |= {("stability", "pair_lowest_theta"), ("stability", "window_peak_theta")}


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.NAMES)
def test_a_study_computed_anew_is_the_reference(name):
    """On any processor: by its scatter where motion is chaotic, 85 % of the values; to 1e-9 elsewhere."""
    study = registry.load(name)
    with xr.open_dataset(KEPT / name / f"{name}.nc") as file:
        kept = file.load()
    sweep = sweep_of(study)
    new = sweep.plan().run()
    assert new.sizes == kept.sizes
    np.testing.assert_array_equal(new["status"], kept["status"])
    for variable in set(map(str, kept.data_vars)) - {"status", "error", "wall_time"}:
        if (name, variable) in IN_ROUNDING:
            continue
        if kept[variable].dtype.kind != "f":
            assert study.chaotic or np.array_equal(new[variable], kept[variable]), variable
            continue
        a, b = kept[variable].values.astype(float), new[variable].values.astype(float)
        if not study.chaotic:
            # Where digits are few, a value in the middle of two may be rounded either way.
            declared = sweep.variables.get(variable)
            rtol = 10.0 ** (1 - declared.digits) if declared and declared.digits else 0.0
            atol = reference.ROUNDING * np.max(np.abs(a), where=np.isfinite(a), initial=0.0)
            np.testing.assert_allclose(b, a, rtol=rtol, atol=atol, err_msg=variable)
        elif limits := reference.tolerance(variable):
            near = (np.abs(a - b) <= limits[0] + limits[1] * np.abs(a)) | (np.isnan(a) & np.isnan(b))
            assert near.mean() >= 0.85, variable
