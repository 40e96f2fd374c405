"""The report page as a file: what it holds, that no text becomes markup, and that its lines give its points."""

import json
import math
import re
import shlex
import shutil
from base64 import b64decode
from html import unescape
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from markupsafe import escape

from studies import registry, runner, spec
from studies.motion import transients
from studies.plotting import figures
from studies.report import page as report
from studies.report.answers import ANSWERS, answers
from studies.report.commands import again, in_python
from studies.report.points import MOST_NUMBERS, points_of
from sweeps.plan import batches

HOSTILE = "</script><script>alert(1)</script><b onclick='x'>&amp;\"'"
KEPT = Path(__file__).parents[3] / "results" / "reference"
MAP = "map/growth_rate-contact_position-mu.nc"


class Elements(HTMLParser):
    """Every element of a page with its attributes."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, name, attributes):
        self.found.append((name, dict(attributes)))

    def of(self, name):
        return [attributes for found, attributes in self.found if found == name]


def written(folder, *names):
    """The text of the page that is written beside the results."""
    return report.write(names, folder, None, pytest.fail).read_text()


@pytest.fixture(scope="module")
def text(folder):
    return written(folder)


@pytest.fixture(scope="module")
def page(text):
    return Elements(text)


def changed(folder, tmp_path, name, change):
    """The page of a copy of one result, with something changed in its file."""
    shutil.copytree(folder / name, tmp_path / name, dirs_exist_ok=True)
    with netCDF4.Dataset(tmp_path / name / f"{name}.nc", "a") as opened:
        change(opened)
    return written(tmp_path, name)


def section(text, anchor):
    return re.search(rf'<section id="{anchor}".*?</section>', text, re.DOTALL)[0]


def data_of(own):
    """The points of a section, as its script reads them."""
    return re.search(r'<script type="application/json"[^>]*>(.*?)</script>', own, re.DOTALL)[1]


def lines_of(text):
    """The commands of a page, or of a part of it."""
    return list(map(unescape, re.findall(r"<pre><code>(.+?)</code>", text)))


@pytest.mark.parametrize("name", ["table4", "fig5", "regimes", "scenes"])
def test_every_result_has_its_question_figure_and_origin(name, folder, text):
    study, own, data = registry.load(name), section(text, name), runner.open_dataset(name, folder)
    assert own.count('<img src="data:image/png;base64,iVBOR') == 1
    for said in (study.question, study.paper, data.attrs["source"], data.attrs["history"][:10]):
        assert escape(said) in own


def test_numbers_stand_beside_the_papers(text):
    row = ["16", "16", "16.0", "0.00"]
    cells = "".join(f'<td class="">{cell}</td>' for cell in row)
    assert f'<th scope="row" class="text">1</th>{cells}' in section(text, "table4")
    assert re.search(r">2800</td><td[^>]*>2802</td><td[^>]*>\+0.1 %<", section(text, "fig5"))


def test_every_section_is_in_the_index(page):
    links = [a["href"] for a in page.of("a")]
    sections = [f"#{a['id']}" for a in page.of("section")]
    assert links[1:3] == sections[:2] == ["#found", "#rig"]
    assert set(sections) <= set(links)
    assert {link[1:] for link in links} <= {a["id"] for _, a in page.found if "id" in a}


def test_answers_come_first_with_the_numbers_of_the_data(folder, tmp_path, text):
    found = section(text, "found")
    assert re.findall(r'<p class="more"><a href="#(.*?)"', found) == ["table4", "fig5"]
    mu = runner.open_dataset("fig5", folder)["onset_mu"].values
    assert f"unstable at μ = {mu[0]:.4f} (2802 Hz), " in found
    assert "first unstable at 0.12 (2800 Hz), 0.16 (400 Hz) and 0.23 (7700 Hz)" in found

    def change(file):
        file["onset_mu"][0] = 0.1
        file.renameVariable("onset_frequency", "other")

    def moved(file):
        file["onset_mu"][0] = 0.1

    assert "unstable at μ = 0.1000 (2802 Hz), " in section(changed(folder, tmp_path, "fig5", moved), "found")
    # What a result lacks it does not answer; of another rig the paper claims nothing.
    assert 'id="found"' not in changed(folder, tmp_path / "less", "fig5", change)
    other = runner.run("fig5", {"mu": [0.1, 0.3], "p1_length": 0.06}, tmp_path / "rig").dataset
    assert [each.paper for each in answers("fig5", other)] == [""]


@pytest.mark.parametrize("name", [name for name in ANSWERS if (KEPT / name / f"{name}.nc").is_file()])
def test_the_kept_results_answer(name):
    """Each has a sentence, whatever its numbers are."""
    found = answers(name, runner.open_dataset(KEPT / name / f"{name}.nc"))
    assert found
    for each in found:
        assert re.search(r"\d", each.finding + each.paper)
        assert not re.search(r"\bnan\b", each.finding)


def test_the_rig_its_symbols_and_its_regimes_are_told_once(text):
    own = section(text, "rig")
    drawn = re.findall(r"<text[^>]*>([^<]*)</text>", own)
    assert {"A", "B", "C", "D", "P1", "P2", "θ", "V", "F", "N", "T"} <= set(drawn)
    assert "one constant coefficient μ" in own
    for name in (*transients.REGIMES, "separation", "contact_position", "p1_length, p2_length"):
        assert f"{name}<" in own, name
    assert text.count('class="rig"') == 1


def test_commands_go_to_the_folder_that_was_given(folder, text):
    missing = section(text, "missing")
    left = [name for name in registry.NAMES if name not in ("table4", "fig5", "regimes", "scenes")]
    assert lines_of(missing) == [f"fiv run {name} --out {folder}" for name in left]
    asked = f"fiv query fig5 --out {folder} --where 'status == \"done\"' --format csv"
    assert lines_of(section(text, "fig5")) == [asked, "fiv run fig5 --set mu=0:0.5:51"]
    refined = lines_of(section(text, "of-" + re.sub("[/.]", "-", f"{folder}/{MAP}")))
    assert refined[0].startswith(f"fiv query {folder}/{MAP} --where ")
    assert (
        refined[1]
        == "fiv map --x contact_position=0.06,0.08,0.1 --y mu=0,0.25,0.5 --quantity growth_rate --refine 2"
    )


def test_where_the_reference_stands_in_the_page_says_so(folder, tmp_path):
    shutil.copytree(folder / "fig5", tmp_path / "reference" / "fig5")
    shutil.copytree(folder / "table4", tmp_path / "table4")
    text = written(tmp_path)
    note = "This is the reference that comes with the project"
    assert text.count(note) == section(text, "fig5").count(note) == text.count("Z, the reference</td>") == 1
    assert lines_of(section(text, "fig5"))[0] == f"fiv run fig5 --out {tmp_path}"
    # Who names the reference's file is told nothing new.
    assert "the reference" not in written(tmp_path, str(tmp_path / "reference/fig5/fig5.nc"))


def test_the_same_results_are_the_same_bytes(folder, text, tmp_path):
    again_written = report.write((), folder, tmp_path / "other" / "page.html", pytest.fail)
    assert again_written.read_text() == text
    assert [path.name for path in again_written.parent.iterdir()] == ["page.html"]


def test_nothing_is_fetched_and_all_can_be_read_aloud(page, text):
    for name, attributes in page.found:
        for key in ("src", "href"):
            assert (attributes.get(key) or "#").startswith(("#", "data:")), (name, attributes)
    assert not re.search(r"@import|url\((?!#)", text)
    policy = next(a["content"] for a in page.of("meta") if "http-equiv" in a)
    assert policy.startswith("default-src 'none'; ")
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


def test_text_of_a_file_stays_text(folder, tmp_path, text):
    own = section(text, "scenes")
    assert ">4 failed<" in own
    assert own.count("ContactError: mu = 3") >= 4

    def change(file):
        file.source = file.title = HOSTILE
        file.history = f"2026-01-01T00:00:00Z {HOSTILE}"
        file["status"].flag_meanings = "pending </script><b>done failed skipped"
        file["wall_time"].long_name = file["wall_time"].units = HOSTILE
        file.set_auto_chartostring(False)
        code = np.frombuffer(HOSTILE.encode().ljust(file["error"].shape[-1], b"\0"), "S1")
        file["error"][...] = np.where(file["status"][...][..., None] == 2, code, b"")

    hostile = changed(folder, tmp_path, "scenes", change)
    assert not re.search(r"<b[ >]", hostile)
    # The script of the page, and one block of data.
    assert len(Elements(hostile).of("script")) == hostile.count("<script") == 2
    (data,) = re.findall(r'<script type="application/json" id="scenes-data">(.*?)</script>', hostile)
    columns = {each["name"]: each for each in json.loads(data)["columns"]}
    assert columns["wall_time"]["about"] == columns["wall_time"]["units"] == HOSTILE
    assert HOSTILE in columns["error"]["values"]
    # The source and the errors.
    assert section(hostile, "scenes").count(str(escape(HOSTILE))) >= 5


@pytest.mark.parametrize("name", ["a;b", "a$(touch x)", "a b", "a'b", '"><b>', "a`id`", "-a", "{V}"])
def test_commands_quote_every_file_name(folder, tmp_path, name):
    """A shell reads the name as one word, and no link leads out of the page."""
    odd = tmp_path / name
    shutil.copytree(folder / "fig5", odd / "fig5")
    shutil.copytree(folder / "map", odd / "map")
    file = odd / "map" / f"{name}.nc"
    file.with_name(Path(MAP).name).rename(file)
    for text in (written(odd), written(folder, str(file))):
        found = Elements(text)
        lines = [line for line in lines_of(text) if str(odd) in line]
        assert lines + [each["data-command"] for each in found.of("div") if "data-command" in each]
        for line in (*lines, *(each["data-command"] for each in found.of("div") if "data-command" in each)):
            words = shlex.split(line)
            assert words[0] == "fiv"
            assert not {";", "$(touch", "x)"} & set(words)
            assert all(
                word.startswith(str(tmp_path)) or word.startswith(str(folder)) for word in words if "/" in word
            )
        assert all(each["href"].startswith("#") for each in found.of("a"))
        assert not re.search(r"<b[ >]", text)


def test_settings_and_axes_of_a_file_are_quoted(folder):
    data = runner.open_dataset(folder / MAP)
    configuration = json.loads(data.attrs["configuration"])
    configuration["constants"]["quantity"] = "a; rm -rf x"
    lines = again(data.assign_attrs(configuration=json.dumps(configuration)))
    assert "; rm" not in lines.whole.replace("'a; rm -rf x'", "")
    odd = data.rename({"mu": "m; x"})
    assert again(odd) == ("", "")


def test_files_that_cannot_be_read_take_only_their_own_sections(folder, tmp_path):
    """What is damaged, what lacks the most, and what no study made; and where nothing is left there is no page."""
    shutil.copytree(folder / "table4", tmp_path / "table4")
    (tmp_path / "map").mkdir()
    whole = (folder / "fig5" / "fig5.nc").read_bytes()
    for name, content in (("half", whole[: len(whole) // 2]), ("empty", b""), ("text", b"a,b")):
        (tmp_path / "map" / f"{name}.nc").write_bytes(content)
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(tmp_path / "map" / "other.nc")
    shutil.copy(folder / "fig5" / "fig5.nc", tmp_path / "map" / "less.nc")
    with netCDF4.Dataset(tmp_path / "map" / "less.nc", "a") as file:
        file.renameVariable("wall_time", "other")
    said = []
    text = report.write((), tmp_path, None, said.append).read_text()
    assert len(said) == text.count("It cannot be shown: ") == 5
    assert not any("\n" in line for line in said)
    assert "<img" in section(text, "table4")


@pytest.mark.parametrize("part", ["_figure", "_findings", "points_of", "_failures", "again", "_facts"])
def test_what_fails_takes_only_its_own_section(folder, tmp_path, monkeypatch, part):
    """Whatever is raised, the others are as they were, and a line says why."""
    from studies.report import context

    own = getattr(context, part)

    def fails(first, *others, **named):
        dataset = getattr(first, "dataset", first)
        if getattr(dataset, "sizes", {}).get("onset") or (part == "_findings" and "Fig. 5" in others[0]):
            raise RuntimeError("of no use\nat all")
        return own(first, *others, **named)

    monkeypatch.setattr(context, part, fails)
    text = report.write((), folder, tmp_path / "page.html", lambda line: None).read_text()
    assert text.count("of no use at all") >= 1
    assert "<img" in section(text, "table4")
    assert "of no use" not in section(text, "table4") + section(text, "regimes")


def test_a_figure_of_other_numbers_is_never_shown(folder, tmp_path):
    """Neither an older one beside newer numbers, nor one from before the digest; what fits is not drawn again."""
    shutil.copytree(folder / "table4", tmp_path / "table4")
    beside = tmp_path / "table4" / "table4.png"
    kept = beside.read_bytes()

    def shown():
        return b64decode(re.search(r'src="data:image/png;base64,([^"]+)"', written(tmp_path, "table4"))[1])

    assert shown() == kept
    beside.write_bytes(kept + b"as it lies there")
    assert shown() == kept + b"as it lies there"
    assert not figures.shows(
        kept.replace(b"tEXtSource", b"tEXtAuthor"), figures.data_digest(runner.open_dataset("table4", tmp_path))
    )
    with netCDF4.Dataset(beside.with_suffix(".nc"), "a") as file:
        file["frequency"][0] *= 1.5
    fresh = shown()
    assert fresh != kept
    beside.unlink()
    assert shown() == fresh


def test_the_digest_is_of_all_that_a_figure_shows(folder, monkeypatch):
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
    # Large data is read in parts.
    monkeypatch.setattr(figures, "READ_BYTES", 1)
    assert figures.data_digest(data) == digest


def test_a_million_points_are_bounded():
    many = np.zeros((1000, 1000), dtype="f4")
    many[::2] = np.random.default_rng(0).normal(size=(500, 1000))
    data = xr.Dataset(
        {"growth_rate": (("theta", "mu"), many), "status": (("theta", "mu"), np.ones(many.shape, dtype="i1"))},
        {"theta": np.linspace(-10, 20, 1000), "mu": np.linspace(0, 1, 1000)},
        {"configuration": json.dumps({"constants": {}}), "sweep": "stability"},
    )
    found = points_of(data)
    embedded = math.prod(len(axis["values"]) for axis in found.data["axes"])
    assert embedded * 4 <= MOST_NUMBERS < 8 * embedded
    said = rf"{embedded} of 1000000 points, one in \d values of theta and one in \d values of mu, to keep "
    assert re.match(said, found.size)
    assert len(json.dumps(found.data)) < 1_000_000
    assert found.data["plane"]


def test_embedded_values_are_those_of_the_file(folder):
    data = runner.open_dataset("regimes", folder)
    told = points_of(data).data
    columns = {each["name"]: each for each in told["columns"]}
    values = np.reshape(columns["velocity_rms"]["values"], data["status"].shape)
    assert np.allclose(values, data["velocity_rms"], rtol=1e-5)
    assert [axis["values"] for axis in told["axes"]] == [data[dim].values.tolist() for dim in data["status"].dims]
    assert told["plane"]["first"] == "regime"
    # What the filter needs: whether a column is of numbers, texts or words, and the settings.
    kinds = {name: columns[name]["kind"] for name in ("status", "regime", "velocity_rms")}
    assert kinds == {"status": "words", "regime": "words", "velocity_rms": "number"}
    assert told["settings"]["d1"] == 50.0
    # And names that an expression can have.
    modes = points_of(runner.open_dataset("fig5", folder)).data
    names = [each["name"] for each in (*modes["axes"], *modes["columns"])]
    assert "growth_rate_mode_1" in names
    assert all(map(str.isidentifier, names))


def test_what_is_at_many_values_of_an_axis_has_a_row_for_each():
    """One rig sample serves all frictions: of each inclination and friction there is a probability."""
    data = runner.open_dataset(KEPT / "robust" / "robust.nc")
    told = points_of(data).data
    columns = {each["name"]: each for each in told["columns"]}
    assert [axis["name"] for axis in told["axes"]] == ["theta", "mu"]
    values = np.reshape(columns["probability_unstable"]["values"], [len(axis["values"]) for axis in told["axes"]])
    assert np.allclose(values, data["probability_unstable"].transpose("theta", "mu"), atol=1e-6)
    nominal = np.reshape(np.array(columns["nominal_onset_mu"]["values"], dtype=float), values.shape)
    assert np.array_equal(np.isnan(nominal[:, 0]), np.isnan(data["nominal_onset_mu"]))
    assert told["plane"]["first"] == "probability_unstable"


def test_the_studies_of_scatter_have_figure_findings_and_rows(tmp_path):
    for name in ("sensitivity", "robust"):
        shutil.copytree(KEPT / name, tmp_path / name)
    sampled = {"scatter": {"mu": "uniform:0.05:0.4"}, "samples": 8, "seed": 1}
    table = tmp_path / "table.csv"
    table.write_text("mu,theta,p1_length [mm]\n0.1,5,50\n0.2,8,51\n")
    for asked in (sampled, {"points": table}):
        runner.execute(runner.plan("fig5", {}, tmp_path, **asked), "sync")
    text = written(tmp_path)
    wanted = {
        "sensitivity": "elasticity_mu_pair_1",
        "robust": "probability_unstable",
        "fig5-scatter": "growth_rate_mode_6",
        "fig5-points": "p1_length",
    }
    for name, column in wanted.items():
        own = section(text, name)
        assert "<img" in own
        assert own.count("<table>") >= 1
        assert "There is no figure" not in own
        assert column in [each["name"] for each in json.loads(data_of(own))["columns"]]
        assert f"fiv query {name} " in own


@pytest.mark.parametrize(
    ("text", "halvings", "typed"),
    [
        ("0.2", 0, "0.2"),
        ("5,10", 0, "5,10"),
        ("0:0.5:101", 0, "0:0.5:101"),
        ("1e-8,1", 0, "1e-08,1"),
        ("log:1e-4:1e-2:5", 3, "log:0.0001:0.01:5"),
        ("log:1e-4:1e-2:2", 3, "log:0.0001:0.01:2"),
        ("0:1:3", 3, "0,0.5,1"),
        ("1,2,7,9", 3, "1,2,7,9"),
    ],
)
def test_values_are_written_as_one_types_them(text, halvings, typed):
    assert spec.written(spec.refined(text, "x", halvings), halvings) == typed


def test_the_command_is_what_was_asked_for(tmp_path, monkeypatch):
    given = {"mu": [0.1, 0.2, 0.25, 0.4], "theta": 8.0, "p1_length": 0.06}
    data = runner.run("fig5", given, tmp_path).dataset
    options = "--set theta=8 --set p1_length=0.06"
    assert again(data) == (
        f"fiv run fig5 --set mu=0.1,0.2,0.25,0.4 {options}",
        f"fiv run fig5 --set mu={{mu}} {options} --out one-point --fresh",
    )
    assert again(data, "my own.py").whole == f"fiv run 'my own.py' --set mu=0.1,0.2,0.25,0.4 {options}"
    # What a command cannot say a file says.
    monkeypatch.setattr(spec, "MOST_LISTED", 3)
    assert lines_of(written(tmp_path, "fig5"))[-1] == f"fiv status fig5 --out {tmp_path} --toml"
    # What does not say what it was asked for has none.
    configuration = json.loads(data.attrs["configuration"])
    del configuration["request"]
    assert again(data.assign_attrs(configuration=json.dumps(configuration))) == ("", "")
    assert again(data.drop_attrs()) == ("", "")


def test_series_are_part_of_the_command(tmp_path):
    given = {"V": [1e-3, 2e-3], "duration": 2e-3, "theta": 5.0, "mu": 0.2, "F": 9.0}
    plan = runner.plan("scenes", given, tmp_path, record=("state", "normal_force"), sample_rate=1e4)
    line = again(plan.run("sync")).whole
    assert line.endswith("--set duration=0.002 --record state,normal_force --sample-rate 10000")
    assert line.startswith("fiv run scenes --set V=0.001,0.002 --set theta=5 ")


@pytest.mark.parametrize(
    ("file", "place", "names"),
    [
        ("regimes/regimes.nc", {"V": 1, "mu": 2, "theta": 0, "F": 0}, ("regime", "velocity_rms", "member_regime")),
        (MAP, {"contact_position": 4, "mu": 8}, ("growth_rate",)),
    ],
)
def test_the_lines_for_a_cell_give_its_point(file, place, names, folder, here):
    data = runner.open_dataset(folder / file)
    row = data.isel(place)

    def filled(line):
        """What the page's script makes of a line for a point."""
        return re.sub(r"\{(\w+)\}", lambda found: repr(row[found[1]].item()), line)

    assert here(*shlex.split(filled(again(data).point))[1:]).returncode == 0
    point = runner.open_dataset(f"one-point/{file}")
    for name in names:
        assert np.array_equal(point[name].values.ravel(), row[name].values.ravel()), name
    found: dict = {}
    line = filled(in_python(data, f"studies.open({str(folder / file)!r})")).replace("print(", "summary = (")
    exec(line, found)
    if "member_regime" in names:
        words = data["regime"].attrs["flag_meanings"].split()
        assert found["summary"]["regime"] == words[int(row["member_regime"][0])].replace("_", " ")
    else:
        assert found["data"].fiv.scene(found["point"]).rig.contact_position == row["contact_position"]


def test_the_command_writes_the_page_and_says_where(folder, tmp_path, here):
    done = here("report", "table4", "--out", str(folder), "--file", "deep/page.html")
    assert (done.returncode, done.stdout, done.stderr) == (0, "deep/page.html\n", "")
    assert (tmp_path / "deep" / "page.html").read_text().count('<section id="table4"') == 1


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("tabel4", 2, "did you mean table4?"),
        ("", 2, "results: nothing of this has been computed there yet; begin with: fiv run table4"),
        ("fig6", 2, "begin with: fiv run fig6"),
        ("results/map/none.nc", 2, "results/map/none.nc: there is no such file"),
        ("./plain", 2, "plain: it is damaged or not netCDF"),
        ("table4 --out {folder} --file plain/page.html", 3, "plain/page.html could not be written"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(folder, tmp_path, here, line, code, said):
    (tmp_path / "plain").write_text("mine")
    done = here("report", *line.format(folder=folder).split())
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (code, "", 1)
    assert done.stderr.startswith("fiv: ")
    assert said in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["plain"]


def test_an_interrupted_run_is_shown_as_far_as_it_is(tmp_path, monkeypatch):
    def interrupt(snapshot):
        if snapshot.done > 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
    with pytest.raises(KeyboardInterrupt):
        runner.plan("fig5", {"mu": np.linspace(0.0, 0.5, 21)}, tmp_path).run("sync", progress=interrupt)
    text = written(tmp_path, "fig5")
    assert "This run is interrupted: here is what was finished." in text
    assert re.search(r"21 \(\d+ pending, \d+ done\)", text)
    assert "fiv run fig5 " in text
