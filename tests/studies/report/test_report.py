"""The report page as a file: what it holds, that no text becomes markup, and that its lines give its points."""

import json
import math
import re
import shlex
import shutil
import sys
from base64 import b64decode
from html import unescape
from html.parser import HTMLParser
from importlib.resources import files
from itertools import pairwise

import netCDF4
import numpy as np
import pytest
from markupsafe import escape

from studies import registry, runner, spec
from studies.cli.main import main
from studies.maps import maps
from studies.plotting import figures
from studies.report import commands
from studies.report import page as report
from studies.report import points as report_points
from studies.report.commands import again, spec_of
from studies.report.points import points_of
from tests.helpers.reports import made

HOSTILE = "</script><script>alert(1)</script><b onclick='x'>&amp;\"'"


class Elements(HTMLParser):
    """Every element of a page with its attributes, and the text of each id's script."""

    def __init__(self, text):
        super().__init__()
        self.found, self.scripts, self._open = [], {}, None
        self.feed(text)

    def handle_starttag(self, name, attributes):
        self.found.append((name, dict(attributes)))
        if name == "script":
            self._open = dict(attributes).get("id", "")

    def handle_data(self, text):
        if self._open is not None:
            self.scripts[self._open] = text

    def handle_endtag(self, name):
        if name == "script":
            self._open = None

    def of(self, name):
        return [attributes for found, attributes in self.found if found == name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made(tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def text(folder):
    return report.write((), folder, None, pytest.fail).read_text()


@pytest.fixture(scope="module")
def page(text):
    return Elements(text)


def changed(folder, tmp_path, name, change):
    """A copy of one result, with something changed in its file; the page of it."""
    there = tmp_path / name
    there.mkdir()
    file = there / f"{name}.nc"
    file.write_bytes((folder / name / f"{name}.nc").read_bytes())
    with netCDF4.Dataset(file, "a") as opened:
        change(opened)
    return report.write((name,), tmp_path, None, pytest.fail).read_text()


def section(text, anchor):
    return re.search(rf'<section id="{anchor}".*?</section>', text, re.DOTALL)[0]


def test_every_result_has_its_question_figure_numbers_cost_and_command(folder, text):
    for name in ("table4", "fig5", "regimes", "scenes"):
        study = registry.load(name)
        own = section(text, name)
        assert escape(study.question) in own
        assert escape(study.paper) in own
        assert own.count('<img src="data:image/png;base64,iVBOR') == 1
        assert "time of computing" in own
        data = runner.open_dataset(name, folder)
        assert escape(data.attrs["source"]) in own
        assert data.attrs["history"][:10] in own
    # The numbers beside the paper's, with the difference.
    assert re.search(
        r'<th scope="row" class="text">1</th><td>16</td><td>16</td><td>16\.0</td><td>0\.00</td>', text
    )
    assert "<td>2800</td><td>2802</td><td>+0.1 %</td>" in section(text, "fig5")


def lines_of(text):
    """The commands of a page, or of a part of it."""
    return [unescape(re.sub("</?span>", "", line)) for line in re.findall(r"<pre><code>(.+?)</code>", text)]


def test_studies_not_run_are_listed_with_their_commands(folder, text):
    """They go to the folder that was given, as what shows more of a result reads it."""
    missing = text.partition('<section aria-labelledby="missing-title">')[2]
    left = [name for name in registry.NAMES if name not in ("table4", "fig5", "regimes", "scenes")]
    assert lines_of(missing) == [f"fiv run {name} --out {folder}" for name in left]
    asked = f"fiv query fig5 --out {folder} --where 'status == \"done\"' --format csv"
    assert lines_of(section(text, "fig5")) == [asked, "fiv run fig5 --set mu=0:0.5:51"]
    refined = section(text, f"of-{re.sub('/|[.]', '-', str(folder))}-map-growth_rate-theta-mu-nc")
    assert lines_of(refined)[0].startswith(f"fiv query {folder}/map/growth_rate-theta-mu.nc --where ")


def test_where_the_reference_stands_in_the_page_says_so(folder, tmp_path):
    shutil.copytree(folder / "fig5", tmp_path / "reference" / "fig5")
    shutil.copytree(folder / "table4", tmp_path / "table4")
    text = report.write((), tmp_path, None, pytest.fail).read_text()
    note = "This is the reference that the project brings along"
    assert text.count(note) == section(text, "fig5").count(note) == text.count("UTC, the reference</td>") == 1
    assert lines_of(section(text, "fig5"))[0] == f"fiv run fig5 --out {tmp_path}"
    # Who names the reference's file is told nothing new.
    named = report.write((str(tmp_path / "reference/fig5/fig5.nc"),), tmp_path, None, pytest.fail).read_text()
    assert "the reference" not in named


def test_the_same_results_are_the_same_bytes(folder, text, tmp_path):
    again_written = report.write((), folder, tmp_path / "other" / "page.html", pytest.fail)
    assert again_written.read_text() == text
    assert [path.name for path in again_written.parent.iterdir()] == ["page.html"]


def test_nothing_is_fetched(page, text):
    for name, attributes in page.found:
        for key in ("src", "href"):
            target = attributes.get(key) or "#"
            assert target.startswith(("#", "data:")), (name, target)
    assert "@import" not in text
    assert not re.findall(r"url\(", text)
    policy = next(a["content"] for a in page.of("meta") if "http-equiv" in a)
    assert policy.startswith("default-src 'none'; ")


def test_headings_tables_and_pictures_can_be_read_aloud(page, text):
    assert dict(page.found[0:1]) == {"html": {"lang": "en"}}
    levels = [int(name[1]) for name, _ in page.found if re.fullmatch(r"h\d", name)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert all(a.get("scope") in ("col", "row") for a in page.of("th"))
    assert all(len(a["alt"]) > 20 for a in page.of("img"))
    assert text.count("<table>") == text.count("<caption")
    ids = [a["id"] for _, a in page.found if "id" in a]
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize("name", ["regimes", "table4"])
def test_text_of_a_file_stays_text(folder, tmp_path, name):
    def change(file):
        file.source = HOSTILE
        file.history = f"2026-01-01T00:00:00Z {HOSTILE}"
        file.title = HOSTILE
        file["status"].flag_meanings = "pending </script><b>done failed skipped"
        file["wall_time"].long_name = HOSTILE
        file["wall_time"].units = HOSTILE

    text = changed(folder, tmp_path, name, change)
    page = Elements(text)
    assert "<b " not in text
    assert "<b>" not in text
    # The script of the page, and one block of data.
    assert len(page.of("script")) == 2
    told = json.loads(page.scripts[f"{name}-data"])
    column = next(each for each in told["columns"] if each["name"] == "wall_time")
    assert column["about"] == column["units"] == HOSTILE
    assert escape(HOSTILE) in text


def test_errors_are_shown_where_and_why_and_escaped(folder, tmp_path, text):
    own = section(text, "scenes")
    assert ">4 failed<" in own
    assert own.count("ContactError: mu = 3") >= 4

    def change(file):
        file.set_auto_chartostring(False)
        wide = file["error"].shape[-1]
        code = np.frombuffer(HOSTILE.encode().ljust(wide, b"\0"), "S1")
        file["error"][...] = np.where(file["status"][...][..., None] == 2, code, b"")

    hostile = changed(folder, tmp_path, "scenes", change)
    assert "<b " not in hostile
    assert escape(HOSTILE) in hostile
    column = next(
        c for c in json.loads(Elements(hostile).scripts["scenes-data"])["columns"] if c["name"] == "error"
    )
    assert HOSTILE in [*column.get("at", {}).values(), column.get("fill"), *column.get("values", [])]


def test_only_the_projects_own_style_and_script_are_no_text():
    template = files("studies.report").joinpath("page.html.j2").read_text()
    assert re.findall(r"[^{ ]+\s*\|\s*safe\b", template) == ["style|safe", "script|safe"]
    assert not re.search(r"autoescape|Markup|html_safe|\|\s*(?:forceescape|e)\b", template)
    for name in ("page.css", *report.SCRIPTS):
        assert "</" not in files("studies.report").joinpath(name).read_text()


def image_of(text):
    """The figure of a page with one result."""
    return b64decode(re.search(r'src="data:image/png;base64,([^"]+)"', text)[1])


def test_a_figure_of_other_numbers_is_never_shown(folder, tmp_path):
    """Neither an older one beside newer numbers, nor a newer one beside older, nor one from before the digest."""
    there = tmp_path / "fig5"
    shutil.copytree(folder / "fig5", there)
    kept = (there / "fig5.png").read_bytes()

    def shown():
        return image_of(report.write(("fig5",), tmp_path, None, pytest.fail).read_text())

    assert shown() == kept
    with netCDF4.Dataset(there / "fig5.nc", "a") as file:
        file["frequency"][0, 0] *= 1.5
    assert shown() != kept
    fresh = runner.plot(registry.load("fig5"), runner.open_dataset("fig5", tmp_path), there / "fig5.nc")
    assert shown() == fresh.read_bytes() != kept
    # What is beside is taken where it fits: a picture is not drawn again for nothing.
    fitting = fresh.read_bytes() + b"as it lies there"
    fresh.write_bytes(fitting)
    assert shown() == fitting
    fresh.write_bytes(kept.replace(b"tEXtSource", b"tEXtAuthor"))
    assert shown() not in (kept, fitting, fresh.read_bytes())
    fresh.unlink()
    assert shown() == runner.image(registry.load("fig5"), runner.open_dataset("fig5", tmp_path))


def test_times_of_computing_are_no_part_of_what_a_figure_shows(folder):
    data = runner.open_dataset("scenes", folder)
    digest = figures.data_digest(data)
    assert figures.data_digest(data.assign(wall_time=2.0 * data["wall_time"])) == digest
    for other in (
        data.assign(regime=data["regime"] + 1),
        data.assign(error=data["error"].str.replace("mu", "nu")),
        data.assign_coords(mu=2.0 * data["mu"]),
        data.assign_attrs(configuration="{}"),
        data.isel(V=[0]),
        data.drop_vars("velocity_rms"),
    ):
        assert figures.data_digest(other) != digest


def test_the_digest_of_large_data_is_read_in_parts_and_the_same(folder, monkeypatch):
    data = runner.open_dataset("fig5", folder)
    digest = figures.data_digest(data)
    monkeypatch.setattr(figures, "READ_BYTES", 100)
    assert figures.data_digest(data) == digest


def test_an_older_file_without_a_figure_or_numbers_says_so(folder, tmp_path):
    text = changed(folder, tmp_path, "regimes", lambda file: file.renameVariable("verdict", "other"))
    assert "They cannot be told of what is there: it lacks" in text
    assert "There is no figure: regimes.nc: it lacks verdict, which the figure shows" in text
    assert "Table of 9 points" in text


def test_what_is_no_result_is_told_and_left_out(folder, tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "mine.nc").write_text("mine")
    (tmp_path / "table4").symlink_to(folder / "table4")
    said = []
    text = report.write((), tmp_path, None, said.append).read_text()
    assert "mine" not in text
    assert said == [f"{tmp_path}/map/mine.nc: it is damaged or not netCDF"]


def test_a_large_grid_is_thinned_and_says_so(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(report_points, "MOST_NUMBERS", 100)
    text = report.write(("fig5",), folder, tmp_path / "page.html", pytest.fail).read_text()
    told = re.search(r"Table of (\d+) of 51 points, every (\w+) value of mu, to keep this page small", text)
    assert told
    data = json.loads(Elements(text).scripts["fig5-data"])
    assert len(data["axes"][0]["values"]) == int(told[1]) < 10
    assert f"fiv query fig5 --out {folder} --where 'status == \"done\"' --format csv" in lines_of(text)


def test_a_million_points_are_bounded():
    import xarray as xr

    many = np.zeros((1000, 1000), dtype="f4")
    many[::2] = np.random.default_rng(0).normal(size=(500, 1000))
    data = xr.Dataset(
        {"growth_rate": (("theta", "mu"), many), "status": (("theta", "mu"), np.ones(many.shape, dtype="i1"))},
        {"theta": np.linspace(-10, 20, 1000), "mu": np.linspace(0, 1, 1000)},
        {"configuration": json.dumps({"constants": {}}), "sweep": "stability"},
    )
    found = points_of(data)
    embedded = math.prod(len(axis["values"]) for axis in found.data["axes"])
    assert embedded * 4 <= report_points.MOST_NUMBERS < 8 * embedded
    assert found.size.startswith(f"{embedded} of 1000000 points, every ")
    assert len(json.dumps(found.data)) < 1_000_000
    assert found.data["plane"]


def test_embedded_values_are_those_of_the_file(folder):
    data = runner.open_dataset("regimes", folder)
    told = points_of(data).data
    columns = {each["name"]: each for each in told["columns"]}
    rms = columns["velocity_rms"]
    values = np.array([rms["values"][k] for k in range(9)]).reshape(data["status"].shape)
    assert np.allclose(values, data["velocity_rms"], rtol=1e-5)
    assert [axis["values"] for axis in told["axes"]] == [data[dim].values.tolist() for dim in data["status"].dims]
    assert told["plane"]["first"] == "regime"
    # What the filter needs: whether a column is of numbers, texts or words, and the settings.
    kinds = {name: columns[name]["kind"] for name in ("status", "regime", "velocity_rms")}
    assert kinds == {"status": "words", "regime": "words", "velocity_rms": "number"}
    assert told["settings"]["d1"] == 50.0


def test_what_a_filter_can_name_has_a_name_that_an_expression_can_have(folder):
    data = points_of(runner.open_dataset("fig5", folder)).data
    names = [each["name"] for each in (*data["axes"], *data["columns"])]
    assert "growth_rate_mode_1" in names
    assert all(map(str.isidentifier, names))


@pytest.mark.parametrize(
    ("values", "halvings", "written"),
    [
        ([0.2], 0, "0.2"),
        ([5.0, 10.0], 0, "5,10"),
        (spec.evenly(0.0, 0.5, 101), 0, "0:0.5:101"),
        ([1e-8, 1.0], 0, "1e-08,1"),
    ],
)
def test_values_are_written_as_one_types_them(values, halvings, written):
    told = spec_of(values, halvings)
    assert told == written
    assert np.array_equal(spec.refined(told, "x", halvings), values)


@pytest.mark.parametrize("text", ["log:1e-4:1e-2:5", "log:1e-4:1e-2:2", "0:1:3", "1,2,7,9"])
def test_a_refined_axis_is_written_by_its_coarse_values(text):
    values = spec.refined(text, "x", 3)
    assert np.array_equal(spec.refined(spec_of(values, 3), "x", 3), values)


def test_the_command_is_what_was_asked_for(tmp_path):
    data = runner.run("fig5", {"mu": [0.1, 0.2], "theta": 8.0, "p1_length": 0.06}, tmp_path).dataset
    options = "--set theta=8 --set p1_length=0.06"
    assert again(data) == (
        f"fiv run fig5 --set mu=0.1,0.2 {options}",
        f"fiv run fig5 --set mu={{mu}} {options} --out one-point --fresh",
    )
    assert again(data, "my own.py").whole == f"fiv run 'my own.py' --set mu=0.1,0.2 {options}"
    # What does not say what it was asked for has none.
    configuration = json.loads(data.attrs["configuration"])
    del configuration["request"]
    assert again(data.assign_attrs(configuration=json.dumps(configuration))) == ("", "")
    assert again(data.drop_attrs()) == ("", "")


OWN = """
from matplotlib.figure import Figure
from studies.study import Study
from sweeps import Axis, Variable
STUDY = Study(
    name="own_squares", title="Squares", question="How large?", paper="Nothing.", axes={"x": Axis([1.0, 3.0])},
    settings={}, function=lambda points: {"y": points["x"] ** 2}, variables={"y": Variable()},
    draw=lambda data: Figure(), findings=lambda data: [],
)
"""


def test_a_study_of_ones_own_is_called_by_its_file(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN)
    runner.run(str(file), {"x": [1.0, 2.0]}, tmp_path)
    text = report.write((str(file),), tmp_path, None, pytest.fail).read_text()
    first, last = lines_of(text)
    assert first.startswith(f"fiv query {file} --out {tmp_path} --where ")
    assert last == f"fiv run {file} --set x=1,2"


def test_what_a_command_cannot_say_a_file_says(tmp_path, monkeypatch):
    monkeypatch.setattr(commands, "MOST_VALUES", 3)
    runner.run("fig5", {"mu": [0.1, 0.2, 0.25, 0.4]}, tmp_path)
    text = report.write(("fig5",), tmp_path, None, pytest.fail).read_text()
    assert lines_of(text)[-1] == f"fiv status fig5 --out {tmp_path} --toml"


def test_series_are_part_of_the_command(tmp_path):
    given = {"V": [1e-3, 2e-3], "duration": 2e-3, "theta": 5.0, "mu": 0.2, "F": 9.0}
    plan = runner.plan("scenes", given, tmp_path, record=("state", "normal_force"), sample_rate=1e4)
    line = again(plan.run("sync")).whole
    assert line.endswith("--set duration=0.002 --record state,normal_force --sample-rate 10000")
    assert line.startswith("fiv run scenes --set V=0.001,0.002 --set theta=5 ")


@pytest.fixture
def fiv(tmp_path, monkeypatch, capsys):
    """Run a line as one types it, in `tmp_path`; its exit code, and what it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FIV_RESULTS", raising=False)

    def run(line):
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as stop:
            main()
        return stop.value.code, *capsys.readouterr()

    return run


def filled(line, row):
    """What the page's script makes of a line for a point."""
    return re.sub(r"\{(\w+)\}", lambda found: repr(row[found[1]].item()), line)


def test_the_lines_for_a_cell_of_a_study_give_its_point(folder, tmp_path, fiv, capsys):
    data = runner.open_dataset("regimes", folder)
    row = data.isel(V=1, mu=2, theta=0, F=0)
    again_line, scene_line, python = points_of(data, again(data).point).data["plane"]["lines"].values()
    assert fiv(filled(again_line, row))[0] == 0
    point = runner.open_dataset("regimes", tmp_path / "one-point")
    for name in ("regime", "velocity_rms", "member_regime", "dominant_frequency"):
        assert np.array_equal(point[name].values.ravel(), row[name].values.ravel()), name
    names: dict = {}
    exec(filled(python, row).replace("print(", "found = ("), names)
    first = names["found"]
    assert first["regime"] == report_points.transients.REGIMES[int(row["member_regime"][0])]
    assert fiv(filled(scene_line, row))[0] == 0
    alone = runner.open_dataset("scenes", tmp_path / "one-point")
    assert float(alone["velocity_rms"].squeeze()) == pytest.approx(first["velocity_rms"], rel=1e-9)


def test_the_lines_for_a_cell_of_a_map_give_its_point(folder, tmp_path, fiv, capsys):
    data = runner.open_dataset(folder / "map" / "growth_rate-contact_position-mu.nc")
    row = data.isel(contact_position=1, mu=2)
    again_line, _, python = points_of(data, again(data).point).data["plane"]["lines"].values()
    assert fiv(filled(again_line, row))[0] == 0
    file = maps.file_of(maps.Plane("contact_position", "mu", None, None), "growth_rate", tmp_path / "one-point")
    assert np.array_equal(runner.open_dataset(file)["growth_rate"].squeeze(), row["growth_rate"])
    exec(filled(python, row), {})
    assert "dominant_frequency" in capsys.readouterr().out
    assert "rig=Rig(contact_position=" in python


def test_the_command_writes_the_page_and_says_where(folder, tmp_path, fiv):
    assert fiv(f"fiv report table4 --out {folder} --file deep/page.html") == (0, "deep/page.html\n", "")
    assert (tmp_path / "deep" / "page.html").read_text().count("<section") == 1


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("fiv report tabel4", 2, "did you mean table4?"),
        ("fiv report", 2, "results: nothing of this has been computed there yet; begin with: fiv run table4"),
        ("fiv report fig6", 2, "begin with: fiv run fig6"),
        ("fiv report results/map/none.nc", 2, "results/map/none.nc: there is no such file"),
        ("fiv report ./plain", 2, "plain: it is damaged or not netCDF"),
        ("fiv report table4 --out {folder} --file plain/page.html", 3, "plain/page.html could not be written"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(folder, tmp_path, fiv, line, code, said):
    (tmp_path / "plain").write_text("mine")
    told = fiv(line.format(folder=folder))
    assert told[:2] == (code, "")
    assert told[2].startswith("fiv: ")
    assert said in told[2]
    assert told[2].count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["plain"]


def test_an_interrupted_run_is_shown_as_far_as_it_is(tmp_path, monkeypatch):
    from sweeps.plan import batches

    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
    plan = runner.plan("fig5", {"mu": np.linspace(0.0, 0.5, 21)}, tmp_path)
    with pytest.raises(KeyboardInterrupt):
        plan.run("sync", progress=_interrupt)
    text = report.write(("fig5",), tmp_path, None, pytest.fail).read_text()
    assert "This run is interrupted: here is what was finished." in text
    assert re.search(r"21 \(\d+ pending, \d+ done\)", text)
    assert "fiv run fig5 " in text


def _interrupt(snapshot):
    if snapshot.done > 4:
        raise KeyboardInterrupt
