"""The report page: what it shows, what it refuses, and how it behaves in the system's Chromium."""

import ast
import gzip
import http.client
import json
import re
import shlex
import shutil
import sys
import time
from base64 import b64decode
from collections import defaultdict
from dataclasses import replace
from functools import partial
from html import unescape
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from studies import registry, runner
from studies.answering import results
from studies.asking import rigs
from studies.asking.request import Request, assignment
from studies.asking.sweep import sweep_of
from studies.plotting import figures, regimes
from studies.report import page, section, watch
from studies.study import Parameter, Study
from sweeps import Axis, InputError, Variable, open_results
from tests import HOME
from tests.helpers import browser

MARKUP = "<b id=injected>loud</b></script>"


def loudness(V, mu, F):
    errors = [ValueError(f"too loud: {MARKUP}") if each else None for each in (V > 5e-3) & (mu > 0.4)]
    return {"loudness": V * mu * F, "error": errors}


def summarise(dataset):
    yield f"It is {MARKUP}."
    yield f"Words {MARKUP}", pd.DataFrame({MARKUP: [MARKUP, "4"]})
    raise KeyError("a typo")


AXES = {"V": Parameter(np.geomspace(1e-3, 1e-2, 4), "m s-1", f"speed {MARKUP}")}
AXES |= {"mu": Parameter(np.linspace(0.0, 0.5, 6)), "F": Parameter(9.0, "N")}
OUTPUTS = {"loudness": ("m s-1", "loudness")}
OWN = Study("own", f"Own {MARKUP}", "", AXES, OUTPUTS, loudness, summary=summarise, figure=lambda _: 1 / 0)


def planned(study, file=None, **values):
    return sweep_of(study, Request(values=values).values_of(study)).plan(file)


@pytest.fixture(autouse=True, scope="module")
def folder(tmp_path_factory):
    """A user's study, a plane of fig5, a file that is no result, and a reference of fig5 and of another study."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("report"))
        patch.delenv("FIV_RESULTS", raising=False)
        patch.setattr(registry, "_registered", {"own": OWN})
        folder, fig5 = Path.cwd() / "mine", registry.load("fig5")
        planned(OWN, folder / "own" / "own.nc").run("sync")
        planned(fig5, folder / "fig5" / "fig5.nc", mu="0:0.5:11", theta="3:12:4", p1_length="60mm").run("sync")
        theirs = folder / "reference" / "fig5" / "fig5.nc"
        planned(fig5, theirs, mu="0:0.5:11").run("sync")
        (folder / "reference" / "rig.svg").touch()
        for file in (folder / "reference" / "fig6" / "fig6.nc", folder / "bad" / "bad.nc"):
            file.parent.mkdir()
            shutil.copy(theirs, file)
        file.write_text("nonsense")
        yield folder


def read(file):
    """A page, its texts by the tag before them, and its points by result."""
    whole, texts = file.read_text("utf-8"), defaultdict(list)
    for tag, text in re.findall(r"<(/?\w+)[^>]*>([^<]+)", whole):
        texts[tag] += [unescape(text).strip()] if text.strip() else []
    embedded = re.findall(r'text/plain" id="[^"]*?(\w+)-points">(.*?)</script>', whole)
    return whole, texts, {name: json.loads(gzip.decompress(b64decode(text))) for name, text in embedded}


def column(data, result, name):
    return next(each["values"] for each in data[result]["columns"] if each["name"] == name)


@pytest.fixture(scope="module")
def written(folder, tmp_path_factory):
    """The page of the whole folder, and the lines that its command prints."""
    told = []
    file = page.write((), folder, tmp_path_factory.mktemp("page") / "report.html", told.append)
    return *read(file), told


def test_own_results_come_first_and_findings_are_the_references(written):
    _, texts, _, told = written
    assert texts["a"][:4] == ["fig5", "own", "fig6", "Two maps"]
    assert texts["h2"][-2:] == ["Your results", "The project's results"]
    assert [text for text in texts["h3"] if text.startswith("What")] == ["What the project found"]
    assert [text for text in texts["td"] if text.endswith("study")] == ["study", "own study", "study"]
    assert any(re.match(r": Steady sliding flutters from mu = 0\.111\d on", text) for text in texts["/a"])
    assert told.count("you have run 1 of the 2 studies; the rest is shown from the project's reference: fig6") == 1
    assert re.fullmatch(r"Newest result: \d{1,2} [A-Z][a-z]{2} \d{4}, \d\d:\d\d UTC", texts["p"][1])


def test_what_fails_is_printed_and_on_the_page(written):
    _, texts, _, told = written
    for what in (
        "o figure: ZeroDivisionError: ",
        "o summary: KeyError: 'a typo' (test_page.py",
        "bad.nc is dam",
    ):
        assert [sum(what in line for line in lines) for lines in (told, texts["p"])] == [1, 1]
    assert f"It is {MARKUP}." in texts["p"]  # what came before the error stays


def test_texts_of_files_and_studies_are_no_markup(written):
    whole, texts, data, _ = written
    assert "<b id" not in whole
    for each in (*(texts[tag] for tag in ("h3", "h5", "th", "td")), column(data, "own", "error")):
        assert any(MARKUP in text for text in each)


def test_points_have_the_values_of_the_file(written, folder):
    _, _, data, _ = written
    with open_results(folder / "own" / "own.nc") as dataset:
        wanted, failed = dataset["loudness"].values, int((dataset["status"] == 2).sum())
        speeds = dataset["V"].values.tolist()
    values = np.array(column(data, "own", "loudness"), dtype=float).reshape(wanted.shape)
    np.testing.assert_allclose(values, wanted, rtol=1e-5, equal_nan=True)
    assert np.isnan(values).sum() == failed == column(data, "own", "status").count("failed") > 0
    assert column(data, "own", "V") == speeds
    assert data["own"]["command"] == ""  # no command finds a user's study by its name


@pytest.mark.parametrize(("rows", "others"), [(13_000, 1), (30, 500), (3, 2)])
def test_large_results_are_thinned_and_say_so(rows, others):
    axes = {"x": Parameter(np.arange(rows) + 0.5), "y": Parameter(np.arange(others) + 0.5)}
    study = Study("large", "Large", "", axes, {"z": ("1", "sum")}, lambda x, y: {"z": x + y})
    found = section.points(study, planned(study).run("sync"), Path("large.nc"))
    kept, total = np.prod(found["shape"]), rows * others
    assert 0.4 * min(total, section.MOST_ROWS) < kept <= section.MOST_ROWS
    kept_text = f"{total} rows" if kept == total else f"{kept} of {total} rows (one in 2 values of"
    assert found["size"].startswith(kept_text)


def test_a_map_has_no_sentence_of_the_paper_and_equal_results_give_equal_pages(tmp_path, monkeypatch):
    axes = {"mu": Parameter(0.2), "theta": Parameter(5.0, "degree")}
    outputs = {"z": ("1", "")}
    study = Study("map_z", "Sum", "?", axes, outputs, lambda mu, theta: {"z": mu + theta}, paper="Table 6")
    monkeypatch.setitem(registry._registered, "map_z", study)
    monkeypatch.setattr(section, "images", lambda _: [])
    planned(study, tmp_path / "map_z" / "map_z.nc", mu="0:1:3", theta="0:1:3").run("sync")
    first, second = (read(page.write(("map_z",), tmp_path, tmp_path / name, pytest.fail)) for name in "ab")
    assert first == second
    assert "Sum over μ and θ" in first[1]["h3"]
    assert "Table 6" not in first[0]


@pytest.mark.parametrize("direction", [("up", "down"), (1, 2)])
def test_every_result_with_a_numeric_parameter_and_another_dimension_has_a_map(direction):
    """Of a study that this process does not know, also over words; parameters go before other dimensions."""
    outputs, coords = {"z": ("1", "", "direction")}, {"direction": Axis(np.array(direction))}
    study = Study("swept", "", "", {"x": AXES["mu"]}, outputs, lambda x: {"z": np.outer(x, x[:2])}, coords=coords)
    dataset = planned(study).run("sync")
    found = section.points(runner.study_of(dataset), dataset, Path("swept.nc"))
    assert [found["dims"][dim] for dim in found["plane"]] == ["x", "direction"]


def test_a_figure_beside_the_file_is_drawn_again_only_for_other_data_or_code(folder, monkeypatch):
    file = folder / "fig5" / "fig5.nc"
    result = section.Result(registry.load("fig5"), open_results(file), file, None)
    monkeypatch.setattr(runner, "image", lambda *_: {"": b"drawn"})
    assert section.images(result) == [b"drawn"]
    digest = runner.picture_digest(result.study, result.dataset)
    other = replace(result, study=replace(result.study, figure=regimes.draw_planes))
    uncompared = replace(result, study=replace(result.study, figure=partial(len, object())))
    with monkeypatch.context() as patch:
        patch.setattr(figures, "is_drawn_from", lambda image, of: (image, of) == (b"stored", digest))
        file.with_suffix(".png").write_bytes(b"stored")
        assert [section.images(each) for each in (result, other, uncompared)] == [
            [b"stored"],
            [b"drawn"],
            [b"drawn"],
        ]
    assert section.images(result) == [b"drawn"]
    file.with_suffix(".png").unlink()


FIGURE = """
from matplotlib.figure import Figure
from studies.study import Parameter, Study

def draw(data):
    figure = Figure(figsize=(1, 1))
    figure.text(0.1, 0.5, "white")
    return figure

def same(x):
    return {"y": x}

STUDY = Study("drawn", "Drawn", "", {"x": Parameter([1.0, 2.0])}, {"y": ("1", "y")}, same, figure=draw)
"""


@pytest.mark.usefixtures("forgetful")
def test_the_page_shows_the_figure_of_the_code_that_is_there(tmp_path, here):
    """And the commands that made the results of one's own study and of a refined map."""
    (tmp_path / "drawn.py").write_text(FIGURE)
    assert here("run", "drawn.py", "--set", "x=1,2,3", "-q").returncode == 0

    def pictures():
        registry._registered.clear()
        sys.modules.pop("drawn")
        assert here("report", "drawn.py").returncode == 0
        return re.findall('data:image/webp;base64,([^"]+)', (tmp_path / "results" / "report.html").read_text())

    white = pictures()
    (tmp_path / "drawn.py").write_text(FIGURE.replace("white", "dark red"))
    dark = pictures()
    assert dark != white
    assert len(dark) == len(white) == 1
    # Each command as it was typed.
    lattice = ("--x", "theta=2:8:3", "--y", "mu=0.1:0.3:3", "--quantity", "growth_rate", "--refine", "1")
    assert here("map", *lattice, "-q").returncode == 0
    assert here("report").returncode == 0
    again = re.findall("<dt>again</dt><dd>([^<]+)</dd>", (tmp_path / "results" / "report.html").read_text())
    assert again == ["fiv run drawn.py --set x=1,2,3", f"fiv map {shlex.join(lattice)}"]
    for command in again:
        done = here(*shlex.split(command)[1:])
        assert (done.returncode, "to do           0" in done.stderr) == (0, True)


@pytest.mark.parametrize(("ratio", "falls"), [(1.0, False), (0.8, True)])
def test_friction_on_the_page_is_that_of_its_results(ratio, falls, tmp_path):
    axes = {"mu": Parameter([0.1, 0.2]), "kinetic_ratio": Parameter(ratio)}
    study = Study("law", "Law", "", axes, {"z": Variable("1", "", (), "int8", flags={1: "one"})}, one)
    dataset = planned(study).run("sync")
    text = page.friction([(section.Result(study, dataset, tmp_path / "law" / "law.nc", None), {})])
    assert ("but it falls with the speed in law" in text) == falls
    # A file returns the only value of an attribute as a scalar.
    dataset["z"].attrs["flag_values"] = np.int8(1)
    assert section.points(study, dataset, tmp_path / "law.nc")["columns"][1]["values"] == ["one", "one"]


def one(mu):
    return {"z": np.ones(len(mu), np.int8)}


def test_results_in_a_folder_that_is_merely_called_like_the_reference_are_ones_own(tmp_path):
    planned(OWN, tmp_path / "reference" / "own" / "own.nc", mu="0:0.5:2").run("sync")
    assert not results.is_reference(tmp_path / "reference" / "own" / "own.nc")
    (tmp_path / "reference" / "rig.svg").touch()
    assert results.is_reference(tmp_path / "reference" / "own" / "own.nc")


@pytest.fixture
def watched(tmp_path, monkeypatch):
    """Watches a result, and calls a step with the page's address at each pause, until there is none left."""

    def watch_by(*steps):
        told, address, left = [], [], iter(steps)

        def sleep(_):
            if not address:  # it waits for the first result
                planned(OWN, tmp_path / "own" / "own.nc", mu="0:0.5:2").run("sync")
            elif (step := next(left, None)) is None:
                raise KeyboardInterrupt
            else:
                step(address[0])

        monkeypatch.setattr(watch, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: 0.0))
        with pytest.raises(KeyboardInterrupt):
            watch.watch((), tmp_path, None, told.append, address.append)
        return told

    return watch_by, lambda _: planned(OWN, tmp_path / "own" / "own.nc", mu="0:0.5:6").run("sync")


def test_a_watched_page_is_written_when_its_results_change_and_served_to_this_machine(watched, tmp_path):
    watch_by, more = watched
    seen = []

    def look(address):
        answers = []
        for host in ("127.0.0.1", "elsewhere.example"):
            connection = http.client.HTTPConnection(address.split("/")[2])
            connection.request("GET", "/", headers={"Host": host})
            answers.append(connection.getresponse())
        assert [answer.status for answer in answers] == [200, 403]
        seen.append((answers[0].read(), (tmp_path / "report.html").stat().st_mtime_ns))

    told = watch_by(look, look, more, look)
    assert seen[0] == seen[1]
    assert [b"23 done" in whole for whole, _ in seen] == [False, False, True]
    assert told[0] == f"{tmp_path} has no results yet; waiting for the first"
    assert len(told) == len(set(told))


@pytest.mark.slow  # that it is written and served is tested above
@pytest.mark.browser
def test_a_watched_page_renews_what_changed_and_keeps_the_rest(driver, watched):
    from selenium.webdriver.support.ui import WebDriverWait

    watch_by, more = watched

    def wait_for(text):
        WebDriverWait(driver, 20.0, 0.1).until(lambda _: text in driver.find_element("tag name", "main").text)

    def open_page(address):
        driver.get(address)
        driver.execute_script("document.querySelector('#rig details').open = true; window.same = true")
        time.sleep(2.5)  # it has asked for the page's time once, which has a resolution of 1 s

    def renewed(_):
        wait_for("23 done")
        assert driver.execute_script("return window.same && document.querySelector('#rig details').open")

    watch_by(open_page, more, renewed)
    WebDriverWait(driver, 20.0).until(lambda _: "has ended" in driver.find_element("tag name", "header").text)


def test_results_of_rigs_stand_under_their_names_with_their_numbers(tmp_path):
    fig5 = registry.load("fig5")
    for name, mass in (("light", "2kg"), ("heavy", "4kg")):
        rigs.define(name, None, {"head_mass": mass}, tmp_path)
        with pytest.raises(InputError, match="has no result"):
            page.write((), tmp_path / name, None, pytest.fail)
        if name == "light":
            planned(fig5, tmp_path / name / "fig5" / "fig5.nc", mu="0:0.5:3", head_mass=mass).run("sync")
    planned(OWN, tmp_path / "heavy" / "map" / "own.nc").run("sync")
    whole, texts, _ = read(page.write((), tmp_path, None, [].append))
    assert texts["h2"][3:] == ["Rig heavy", "Rig light"]
    assert [text for text in texts["p"] if text.startswith("head_mass")] == ["head_mass = 4kg", "head_mass = 2kg"]
    assert re.findall('data-name="([^"]*)"', whole) == ["heavy: own", "own", "light: fig5", "fig5"]
    # Its results are its own alone on a page of one rig.
    _, texts, _ = read(page.write((), tmp_path / "light", None, [].append))
    assert texts["h2"][2:] == ["Rig light"]


def test_refusals(folder, tmp_path):
    (tmp_path / "bad").mkdir()
    for out, what in ((tmp_path / "nodir", "does not exist"), (tmp_path, "has no results")):
        with pytest.raises(InputError, match=f"{out.name}: the folder {what}; begin with: fiv run fig5 --out"):
            page.write((), out, None, pytest.fail)
    assert [each.name for each in tmp_path.iterdir()] == ["bad"]
    for target, told in (("fig55", "no result 'fig55'"), (str(folder / "bad" / "bad.nc"), "is damaged")):
        with pytest.raises(InputError, match=told):
            page.write((target,), folder, None, [].append)


@pytest.fixture
def driver(tmp_path):
    """A Chromium of the system, which saves into `tmp_path`."""
    pytest.importorskip("selenium", reason="selenium is not installed; it is in fiv[test-all]")
    if None in browser.programs():
        pytest.skip("Chromium or its driver is missing; try: apt-get install chromium chromium-driver")
    with browser.chromium(tmp_path) as driver:
        yield driver


def check_for_everybody(driver, pixels, colours, rules):
    """Nothing is wider than the window, and axe-core finds nothing wrong."""
    browser.resize(driver, pixels, 900, colours)
    assert driver.execute_script("return document.documentElement.scrollWidth") <= pixels
    if browser.load_axe(driver):
        check = "axe.run({ rules: arguments[0] }).then(({ violations }) => arguments[1](violations))"
        found = driver.execute_async_script(check, rules)
        assert [(each["id"], each["nodes"][0]["html"]) for each in found] == []


@pytest.mark.browser
def test_in_a_browser(driver, folder, tmp_path):
    from selenium.webdriver import ActionChains, Keys
    from selenium.webdriver.support.ui import Select, WebDriverWait

    def texts(css):
        script = "return [...document.querySelectorAll(arguments[0])].map((each) => each.textContent)"
        return driver.execute_script(script, css)

    def wait(condition):
        return WebDriverWait(driver, 10.0, 0.05).until(lambda _: condition())

    file = page.write((), folder, tmp_path / "report.html", lambda line: None)
    driver.get(file.as_uri())
    # A click on the map gives the values of a point, and the command that computes it.
    own = "section[id$=mine-fig5-fig5]"
    canvas = driver.find_element("css selector", f"{own} canvas")
    driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    right, up = (int(0.45 * canvas.size[side]) for side in ("width", "height"))
    ActionChains(driver).move_to_element_with_offset(canvas, right, -up).click().perform()
    cell = dict(zip(texts(f"{own} .cell dt"), texts(f"{own} .cell dd"), strict=True))
    assert (cell["μ"], cell["θ °"]) == ("0.5", "12")
    words = shlex.split(texts(f"{own} .cell code")[0])
    values = dict(assignment(after) for word, after in pairwise(words) if word == "--set")
    assert (words[:3], values) == (["fiv", "run", "fig5"], {"p1_length": "0.06", "mu": "0.5", "theta": "12"})
    python = texts(f"{own} .cell code")[1].partition("\n")[2]
    call = ast.parse(python, mode="eval").body
    given = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
    assert (ast.unparse(call.func), ast.literal_eval(call.args[0])) == ("studies.run", "fig5")
    assert given == {"out": "again", "fresh": True} | {k: float(v) for k, v in values.items()}
    # Two maps side by side have one scale, and a click in one chooses the point of both.
    sides = driver.find_elements("css selector", "#compare select")
    for select, name in zip(sides, ("fig5", "reference: fig6"), strict=True):
        Select(select).select_by_visible_text(name)
    wait(lambda: len(texts(".pair .legend")) == 2)
    assert len(set(texts(".pair .legend"))) == 1
    driver.find_element("css selector", ".pair input[aria-label=μ]").send_keys(Keys.END)
    assert texts(".pair .map:last-child output")[0] == " μ: 0.5"
    again = planned(registry.load("fig5"), **values).run("sync").sel(mode=int(cell["mode"])).squeeze()
    assert float(cell["growth_rate 1/s"]) == pytest.approx(float(again["growth_rate"]), rel=1e-5)
    # A table sorts, searches and is saved.
    table = "section[id$=mine-own-own] .points"
    driver.find_element("css selector", f"{table} summary").click()
    wait(lambda: texts(f"{table} td"))
    driver.find_element("css selector", f"{table} th:nth-child(3)").click()

    def ascending():
        cells = texts(f"{table} td:nth-child(3)")
        numbers = [float(text) for text in cells if text != "–"]
        return cells if numbers and numbers == sorted(numbers) else None

    cells = wait(ascending)
    driver.find_element("css selector", f"{table} input[type=search]").send_keys("failed")
    assert wait(lambda: set(texts(f"{table} td:nth-child(4)")) == {"failed"})
    driver.find_element("css selector", f"{table} .buttons-csv").click()
    saved = pd.read_csv(wait(lambda: next(tmp_path.glob("own.csv"), None)))
    assert [*saved] == texts(f"{table} thead th")
    assert saved["loudness mm/s"].isna().all()
    assert len(saved) == cells.count("–")
    assert set(texts(f"{own} .cell code span")) == {"--scheduler", "--out", "--fresh", "--set"}
    for pixels in (1200, 375):
        for colours in ("light", "dark"):
            check_for_everybody(driver, pixels, colours, {})
    hidden = "const cell = document.querySelector('.cell'); return cell.scrollHeight - cell.clientHeight"
    assert driver.execute_script(hidden) == 0  # a phone scrolls the page, not a box in it
    assert not driver.find_elements("css selector", "#injected")
    assert driver.get_log("browser") == []
    events = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    asked = [
        event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"
    ]
    assert {url for url in asked if url.startswith(("http", "file"))} == {file.as_uri()}


@pytest.mark.browser
def test_it_moves_where_it_is_seen_and_less_motion_is_not_wanted(driver, tmp_path):
    """In light and dark, on a phone, by key and slider; it stands still on hidden tabs and out of sight."""
    from selenium.webdriver import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    reference = HOME / "results" / "reference"
    file = page.write(("fig6", "contact"), reference, tmp_path / "report.html", lambda line: None)

    def media(**features):
        emulated = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": emulated})

    def picture(player):
        return driver.execute_script("return arguments[0].querySelector('canvas').toDataURL()", player)

    def moves(player):
        """Whether the picture of a player changes within some frames."""
        before = picture(player)
        wait = "const next = (k) => k ? requestAnimationFrame(() => next(k - 1)) : arguments[0](); next(12)"
        driver.execute_async_script(wait)
        return picture(player) != before

    def open_page():
        driver.get(file.as_uri())
        found = WebDriverWait(driver, 20.0, 0.1).until(
            lambda _: driver.find_elements("css selector", ".player canvas")
        )
        WebDriverWait(driver, 20.0, 0.1).until(
            lambda _: len(driver.find_elements("css selector", ".player button")) == 3
        )
        assert all(each.get_attribute("aria-label").startswith("Animation: ") for each in found)
        players = driver.find_elements("css selector", ".player")
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", players[0])
        return players

    media(prefers_reduced_motion="no-preference")
    mode, _, last = open_page()
    button, slider = (mode.find_element("css selector", css) for css in ("button", "input"))
    WebDriverWait(driver, 20.0, 0.1).until(lambda _: moves(mode))
    assert not moves(last)  # it is below the window
    hidden = "Object.defineProperty(document, 'hidden', {value: arguments[0], configurable: true}); "
    hidden += "document.dispatchEvent(new Event('visibilitychange'))"
    driver.execute_script(hidden, True)
    assert not moves(mode)
    driver.execute_script(hidden, False)
    WebDriverWait(driver, 20.0, 0.1).until(lambda _: moves(mode))
    assert button.text == "Pause"
    button.send_keys(Keys.ENTER)
    assert (button.text, moves(mode)) == ("Play", False)
    before = picture(mode)
    slider.send_keys(Keys.HOME, Keys.ARROW_RIGHT)
    assert (slider.get_property("value"), picture(mode) != before) == ("1", True)
    light = picture(mode)
    media(prefers_color_scheme="dark", prefers_reduced_motion="no-preference")
    WebDriverWait(driver, 20.0, 0.1).until(lambda _: picture(mode) != light)
    # Where less motion is wanted it waits for its button, and stops if that is wanted later.
    media(prefers_reduced_motion="reduce")
    mode, *_ = open_page()
    button = mode.find_element("css selector", "button")
    assert (button.text, moves(mode)) == ("Play", False)
    button.click()
    WebDriverWait(driver, 20.0, 0.1).until(lambda _: moves(mode))
    media(prefers_reduced_motion="no-preference")
    assert moves(mode)
    media(prefers_reduced_motion="reduce")
    WebDriverWait(driver, 20.0, 0.1).until(lambda _: button.text == "Play")
    assert not moves(mode)
    for colours in ("light", "dark"):
        check_for_everybody(driver, 375, colours, {})
    assert driver.get_log("browser") == []


@pytest.mark.browser
@pytest.mark.parametrize("names", [("fig5", "sensitivity"), pytest.param((), marks=pytest.mark.slow)])
def test_the_page_of_the_reference_is_small_and_for_everybody(driver, tmp_path, names):
    file = page.write(names, HOME / "results" / "reference", tmp_path / "report.html", lambda line: None)
    assert file.stat().st_size < 3e6
    driver.get(file.as_uri())
    check_for_everybody(driver, 375, "light", {"color-contrast": {"enabled": False}})  # which takes minutes here
