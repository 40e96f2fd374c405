"""The report page in a browser: it shows its results, answers to mouse and keys, and fetches nothing."""

import json
import re
import shlex

import numpy as np
import pytest

from studies import registry, runner
from studies.query.query import query
from studies.report import page as report
from tests.helpers.browser import browser, printed, resize, scheme

pytestmark = pytest.mark.browser
CENTRED = "arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})"


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def file(driver, request, tmp_path_factory):
    """The page; the driver comes first, so that nothing is computed where there is none."""
    target = tmp_path_factory.mktemp("page") / "report.html"
    return report.write((), request.getfixturevalue("folder"), target, pytest.fail)


@pytest.fixture
def page(driver, file):
    """The page newly opened at the width of a desk."""
    resize(driver, 1200)
    scheme(driver, "light")
    driver.get_log("performance")
    driver.get(file.as_uri())
    yield driver
    assert driver.get_log("browser") == []


def one(page, css):
    return page.find_element("css selector", css)


def texts(page, css):
    script = "return [...document.querySelectorAll(arguments[0])].map((each) => each.textContent)"
    return page.execute_script(script, css)


def opened(page, study):
    """The table of all points of a study."""
    from selenium.webdriver.support.ui import WebDriverWait

    one(page, f"#{study} summary").click()
    table = f"#{study} .points"
    WebDriverWait(page, 5.0, 0.02).until(lambda _: texts(page, f"{table} tbody tr"))
    return table


def place(page, table, name):
    """Which column of the table it is, from 1 on."""
    return 1 + [head.split(" (")[0] for head in texts(page, f"{table} thead th")].index(name)


def column(page, table, name):
    """What stands in a column of the table."""
    return texts(page, f"{table} tbody tr > :nth-child({place(page, table, name)})")


def clicked(page, study, across, up):
    """Click a place of the map, in shares of its width and height; what the panel beside it says then."""
    from selenium.webdriver import ActionChains

    picture = one(page, f"#{study} canvas")
    page.execute_script(CENTRED, picture)
    size = picture.size
    left, right, top, bottom = 58, 10, 10, 46  # EDGE of map.js
    x = left + across * (size["width"] - left - right) - size["width"] / 2
    y = top + (1 - up) * (size["height"] - top - bottom) - size["height"] / 2
    ActionChains(page).move_to_element_with_offset(picture, round(x), round(y)).click().perform()
    return cell(page, study)


def cell(page, study):
    """What the panel beside a map says, by name."""
    return dict(zip(texts(page, f"#{study} .cell dt"), texts(page, f"#{study} .cell dd"), strict=True))


def selected(page, study, which, text):
    """Choose an entry of a list above a map."""
    from selenium.webdriver.support.ui import Select

    Select(page.find_elements("css selector", f"#{study} .choose select")[which]).select_by_visible_text(text)


def test_it_shows_every_result_and_requests_nothing_but_itself(page):
    assert page.title == "Friction-induced vibration: results"
    assert len(page.find_elements("css selector", "main > section")) == 8
    assert page.execute_script("return [...document.images].every((i) => i.complete && i.naturalWidth > 500)")
    address = page.current_url
    one(page, ".overview a[href='#regimes']").click()
    assert page.current_url == f"{address}#regimes"
    opened(page, "regimes")
    clicked(page, "regimes", 0.5, 0.5)
    told = [json.loads(entry["message"])["message"] for entry in page.get_log("performance")]
    wanted = [each["params"]["request"]["url"] for each in told if each["method"] == "Network.requestWillBeSent"]
    assert [url for url in wanted if not url.startswith("data:")] == [address]


def test_clicks_sort_up_and_down(page):
    table = opened(page, "regimes")
    for name, read in (("velocity_rms", float), ("regime", str)):
        head = f"{table} thead th:nth-child({place(page, table, name)})"
        for order, down in (("ascending", False), ("descending", True)):
            one(page, f"{head} button").click()
            values = [read(text) for text in column(page, table, name)]
            assert values == sorted(values, reverse=down)
            assert one(page, head).get_attribute("aria-sort") == order
            assert len(page.find_elements("css selector", f"{table} [aria-sort=none]")) > 5


def test_conditions_filter(page):
    """What the filter understands is that of `test_shared_expressions.py`."""
    table = opened(page, "regimes")
    every = list(zip(*(column(page, table, name) for name in ("mu", "V")), strict=True))
    wanted = [(mu, V) for mu, V in every if float(mu) > 0.2 or V == "0.001"]
    assert 0 < len(wanted) < len(every)
    box = one(page, f"{table} input")
    box.send_keys("mu > 0.2 or V == 0.001")
    assert list(zip(*(column(page, table, name) for name in ("mu", "V")), strict=True)) == wanted
    assert texts(page, f"{table} [role=status]") == [f"{len(wanted)} of 9 points; {len(wanted)} shown."]
    box.clear()
    box.send_keys("nu > 0.2")
    (said,) = texts(page, f"{table} [role=status]")
    assert re.fullmatch(r"no such column: nu; there are V, mu, .*; all are shown. 9 of 9 points; 9 shown.", said)
    box.clear()
    box.send_keys("mu ((")
    (said,) = texts(page, f"{table} [role=status]")
    assert said.startswith("unexpected '(' at column 4; all are shown.")
    assert box.get_attribute("aria-invalid") == "true"


def test_the_command_and_the_csv_follow_filter_columns_and_order(page, folder):
    table = opened(page, "regimes")
    asked = f"fiv query regimes --out {folder} --where "
    assert texts(page, f"{table} .command code") == [f"{asked}'status == \"done\"' --format csv"]
    one(page, f"{table} input[type=search]").send_keys("mu > 0.2 and regime != 'stuck'")
    one(page, f"{table} .chooser summary").click()
    page.find_elements("css selector", f"{table} .chooser button")[1].click()
    for name in ("mu", "velocity_rms"):
        boxes = page.find_elements("css selector", f"{table} .chooser label")
        next(each for each in boxes if each.text == name).click()
    assert [head for head in page.find_elements("css selector", f"{table} thead th") if head.is_displayed()] != []
    heads = [each.text for each in page.find_elements("css selector", f"{table} thead th") if each.is_displayed()]
    assert [head.split(" (")[0] for head in heads] == ["mu", "velocity_rms"]
    head = f"{table} thead th:nth-child({place(page, table, 'velocity_rms')}) button"
    one(page, head).click()
    one(page, head).click()
    (line,) = texts(page, f"{table} .command code")
    where = """'mu > 0.2 and regime != "stuck"'"""
    assert line == f"{asked}{where} --show mu,velocity_rms --sort -velocity_rms --format csv"
    done = query(
        runner.open_dataset("regimes", folder), shlex.split(line)[6], show="mu,velocity_rms", sort="-velocity_rms"
    )
    saved = page.execute_script(
        "URL.createObjectURL = (blob) => { window.saved = blob; return '#'; };"
        "document.querySelector(arguments[0]).click(); return window.saved.text()",
        f"{table} > button:last-of-type",
    )
    first, *rows = saved.splitlines()
    assert first == "mu,velocity_rms"
    assert np.allclose([[float(cell) for cell in row.split(",")] for row in rows], done.to_numpy(), rtol=1e-5)


def test_a_column_that_the_file_names_otherwise_has_no_command(page):
    table = opened(page, "fig5")
    one(page, f"{table} input[type=search]").send_keys("growth_rate_mode_6 > 0")
    assert not one(page, f"{table} .command").is_displayed()
    assert texts(page, f"{table} > .hint") == ["No command: a column of this page has no such name in the file."]
    assert 0 < len(column(page, table, "mu")) < 51


def test_a_link_to_what_is_folded_opens_it(page, tmp_path):
    runner.run("stress", {"case": [registry.load("stress").texts["case"][0]]}, tmp_path)
    page.get(report.write(["stress"], tmp_path, None, pytest.fail).as_uri())
    assert not one(page, "#stress figure").is_displayed()
    from selenium.webdriver.support.ui import WebDriverWait

    one(page, ".index a[href='#stress']").click()
    WebDriverWait(page, 5.0, 0.02).until(lambda _: one(page, "#stress figure").is_displayed())


def test_the_index_is_beside_wide_pages_and_above_narrow_ones(page):
    boxes = (
        "return ['.index', '#results'].map((each) => "
        "document.querySelector(each).getBoundingClientRect().toJSON())"
    )
    index, results = page.execute_script(boxes)
    assert index["right"] <= results["left"]
    resize(page, 390, 844, mobile=True)
    index, results = page.execute_script(boxes)
    assert index["bottom"] <= results["top"]


def test_a_long_table_is_shown_in_parts(page):
    table = opened(page, "fig5")
    assert len(column(page, table, "mu")) == 25
    more = one(page, f"{table} > button")
    more.click()
    assert len(column(page, table, "mu")) == 51
    assert not more.is_displayed()


def test_a_cell_tells_its_scene_its_figures_and_its_lines(page):
    from selenium.webdriver import Keys

    told = clicked(page, "regimes", 0.1, 0.1)
    assert [told[name] for name in ("V / (mm/s)", "μ", "θ / °", "F / N")] == ["1", "0.05", "5", "9"]
    assert told["regime"] == "steady sliding"
    told = clicked(page, "regimes", 0.9, 0.9)
    assert told["regime"] != "steady sliding"
    lines = texts(page, "#regimes .cell code")
    assert lines[0].startswith("fiv run regimes --set V=0.005 --set mu=0.3 --set theta=5 --set F=9 ")
    assert "dict(V=0.005, mu=0.3, theta=5, F=9)" in lines[1]
    # The table says the same of the point.
    table = opened(page, "regimes")
    one(page, f"{table} input").send_keys("V == 0.005 and mu == 0.3")
    assert [f"{value} m s-1" for value in column(page, table, "velocity_rms")] == [told["velocity_rms"]]
    # Arrow keys move on, and stop at the edge.
    one(page, "#regimes canvas").send_keys(Keys.ARROW_UP, Keys.ARROW_LEFT, Keys.ARROW_DOWN)
    told = cell(page, "regimes")
    assert (told["V / (mm/s)"], told["μ"]) == ("2", "0.2")
    assert texts(page, "#regimes .said") == [f"V / (mm/s) 2 μ 0.2 θ / ° 5 F / N 9; regime: {told['regime']}"]


def test_the_map_is_drawn_in_the_colours_of_its_legend(page):
    drawn = """
        const canvas = document.querySelector("#regimes canvas");
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", {willReadFrequently: true});
        copy.drawImage(canvas, 0, 0);
        const found = copy.getImageData(0, 0, canvas.width, canvas.height).data;
        const seen = new Set();
        for (let k = 0; k < found.length; k += 4) seen.add(`rgb(${[...found.slice(k, k + 3)].join(", ")})`);
        return [...seen];
    """
    swatches = "return [...document.querySelectorAll('#regimes .legend i')].map((i) => i.style.backgroundColor)"
    assert "steady sliding" in texts(page, "#regimes .legend span")
    seen = page.execute_script(drawn)
    assert set(page.execute_script(swatches)) <= set(seen)
    # Another figure has other colours.
    selected(page, "regimes", 0, "velocity_rms")
    assert set(page.execute_script(drawn)) != set(seen)
    assert "m s-1" in texts(page, "#regimes .legend")[0]


@pytest.mark.parametrize(
    ("low", "high", "most", "middle", "values"),
    [
        (-10, 20, 9, 5, [-10, -5, 0, 5, 10, 15, 20]),
        (0, 0.5, 12, 0.25, [0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5]),
        (0.37, 1.21, 5, 0.8, [0.4, 0.6, 0.8, 1, 1.2]),
        (0.5, 30, 9, 4, [0.5, 1, 2, 5, 10, 20]),
        (0.02, 300, 6, 2.5, [0.1, 1, 10, 100]),
    ],
)
def test_a_map_has_round_ticks(page, low, high, most, middle, values):
    assert page.execute_script(f"return round({low}, {high}, {most}, {middle})") == values


def test_other_axes_are_chosen_beside_the_map(page):
    assert len(page.find_elements("css selector", "#scenes .choose select")) == 3
    assert cell(page, "scenes")["θ / °"] == "5"
    selected(page, "scenes", 1, "40")
    told = cell(page, "scenes")
    assert (told["θ / °"], told["status"]) == ("40", "failed")
    assert "ContactError" in told["error"]


def test_a_phone_scrolls_only_down(page):
    for study in ("regimes", "fig5", "scenes"):
        opened(page, study)
    for width in (390, 320):
        resize(page, width, 844, mobile=True)
        wide = "return [document.documentElement.scrollWidth, document.body.scrollWidth]"
        assert max(page.execute_script(wide)) <= width
        assert page.execute_script("return visualViewport.scale") == 1


CONTRAST = """
    const light = (text) => {
      const parts = text.match(/[\\d.]+/g).slice(0, 3).map((part) => part / 255);
      const linear = parts.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
      return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    };
    const behind = (node) => {
      const colour = getComputedStyle(node).backgroundColor;
      return /, 0\\)$/.test(colour) && node.parentElement ? behind(node.parentElement) : colour;
    };
    const poor = [];
    const texts = "h1, h2, h3, h4, p, a, th, td, dt, dd, code, button, summary, label";
    for (const node of document.querySelectorAll(texts)) {
      const [one, other] = [light(getComputedStyle(node).color), light(behind(node))].sort((a, b) => a - b);
      if ((other + 0.05) / (one + 0.05) < 4.5) poor.push(node.outerHTML.slice(0, 80));
    }
    return poor;
"""


@pytest.mark.parametrize("name", ["light", "dark"])
def test_both_schemes_have_contrast(page, name):
    scheme(page, name)
    style = "return getComputedStyle(document.querySelector(arguments[0])).backgroundColor"
    shade = sum(map(int, re.findall(r"\d+", page.execute_script(style, "body"))))
    assert (shade > 600) == (name == "light")
    opened(page, "scenes")
    assert page.execute_script(CONTRAST) == []
    # Figures stay on white.
    assert page.execute_script(style, "figure img") == "rgb(255, 255, 255)"


def test_a_print_has_figures_and_numbers_without_controls(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert all(one(page, f"#regimes {css}").is_displayed() for css in ("figure img", "table", ".facts"))
        assert not any(one(page, f"#regimes {css}").is_displayed() for css in (".plane", "details", "button"))
    finally:
        page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert 6 <= len(re.findall(rb"/Type\s*/Page\b", printed(page))) <= 14


def test_every_control_has_a_name_and_can_be_reached(page):
    opened(page, "scenes")
    unnamed = """
        const named = (node) => node.textContent.trim() || node.getAttribute("aria-label")
          || (node.labels && node.labels.length);
        return [...document.querySelectorAll("button, a, input, select, canvas, [tabindex]")]
          .filter((node) => !named(node) || node.tabIndex < 0).map((node) => node.outerHTML.slice(0, 80));
    """
    assert page.execute_script(unnamed) == []


def test_a_line_is_copied(page):
    granted = ["clipboardReadWrite", "clipboardSanitizedWrite"]
    page.execute_cdp_cmd("Browser.grantPermissions", {"permissions": granted})
    one(page, "#fig5 > .command button").click()
    copied = page.execute_async_script("navigator.clipboard.readText().then(arguments[0], arguments[0])")
    assert copied == "fiv run fig5 --set mu=0:0.5:51"
