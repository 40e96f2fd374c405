"""The report page in a browser: it shows its results, answers to mouse, touch and keys, and fetches nothing."""

import json
import re

import pytest

from studies.report import page as report
from tests.helpers import browser as chromium
from tests.helpers.browser import browser, printed, resize, scheme
from tests.helpers.reports import made

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def file(driver, tmp_path_factory):
    """The page; the driver comes first, so that nothing is computed where there is none."""
    return report.write((), made(tmp_path_factory.mktemp("report")), None, pytest.fail)


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
    return [each.get_attribute("textContent") for each in page.find_elements("css selector", css)]


def opened(page, study):
    """The table of all points of a study."""
    from selenium.webdriver.support.ui import WebDriverWait

    one(page, f"#{study} summary").click()
    table = f"#{study} .points"
    WebDriverWait(page, 5.0, 0.02).until(lambda _: texts(page, f"{table} tbody tr"))
    return table


def column(page, table, name):
    """What stands in a column of the table, as numbers where they are."""
    heads = texts(page, f"{table} thead th")
    place = next(k for k, head in enumerate(heads) if head.split(" (")[0] == name) + 1
    return [number(text) for text in texts(page, f"{table} tbody tr > :nth-child({place})")]


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def head(page, table, name):
    return next(
        each
        for each in page.find_elements("css selector", f"{table} thead button")
        if each.get_attribute("textContent").split(" (")[0] == name
    )


def moved_to(page, study, across, up):
    """Put the mouse on a place of the map, in shares of its width and height."""
    from selenium.webdriver import ActionChains

    picture = one(page, f"#{study} canvas")
    page.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", picture)
    size = picture.size
    left, right, top, bottom = 58, 10, 10, 46  # EDGE of report_map.js
    x = left + across * (size["width"] - left - right) - size["width"] / 2
    y = top + (1 - up) * (size["height"] - top - bottom) - size["height"] / 2
    ActionChains(page).move_to_element_with_offset(picture, round(x), round(y)).perform()
    return picture


def cell(page, study):
    """What the panel beside a map says: names with values, and lines."""
    names, values = texts(page, f"#{study} .cell dt"), texts(page, f"#{study} .cell dd")
    return dict(zip(names, values, strict=True)), texts(page, f"#{study} .cell code")


def test_it_shows_every_result_and_the_console_is_silent(page):
    assert page.title == "Friction-induced vibration: results"
    assert len(page.find_elements("css selector", "main > section")) == 7
    assert page.execute_script("return [...document.images].every((i) => i.complete && i.naturalWidth > 500)")
    one(page, ".overview a[href='#regimes']").click()
    assert page.current_url.endswith("#regimes")


def test_nothing_is_requested_but_the_page(page):
    opened(page, "regimes")
    moved_to(page, "regimes", 0.5, 0.5)
    told = [json.loads(entry["message"])["message"] for entry in page.get_log("performance")]
    wanted = [each["params"]["request"]["url"] for each in told if each["method"] == "Network.requestWillBeSent"]
    assert [url for url in wanted if not url.startswith("data:")] == [page.current_url]
    found = page.execute_script("return performance.getEntriesByType('resource').map((each) => each.name)")
    assert [name for name in found if not name.startswith("data:")] == []


def test_clicks_sort_up_and_down(page):
    table = opened(page, "regimes")
    first = column(page, table, "velocity_rms")
    assert first != sorted(first)
    head(page, table, "velocity_rms").click()
    assert column(page, table, "velocity_rms") == sorted(first)
    sorts = [each.get_attribute("aria-sort") for each in page.find_elements("css selector", f"{table} thead th")]
    assert sorts.count("ascending") == 1
    head(page, table, "velocity_rms").click()
    assert column(page, table, "velocity_rms") == sorted(first, reverse=True)
    head(page, table, "regime").click()
    assert column(page, table, "regime") == sorted(column(page, table, "regime"))


def test_the_keyboard_sorts_too(page):
    from selenium.webdriver import Keys

    table = opened(page, "table4")
    head(page, table, "mode").send_keys(Keys.ENTER)
    head(page, table, "mode").send_keys(Keys.SPACE)
    assert column(page, table, "mode") == [8, 7, 6, 5, 4, 3, 2, 1]
    head(page, table, "mode").send_keys(Keys.TAB)
    assert page.switch_to.active_element == head(page, table, "status")


def test_conditions_filter(page):
    """What the filter understands is that of `test_shared_expressions.py`."""
    table = opened(page, "regimes")
    every = list(zip(*(column(page, table, name) for name in ("mu", "V")), strict=True))
    wanted = [(mu, V) for mu, V in every if mu > 0.2 or V == 0.001]
    assert 0 < len(wanted) < len(every)
    one(page, f"{table} input").send_keys("mu > 0.2 or V == 0.001")
    assert list(zip(*(column(page, table, name) for name in ("mu", "V")), strict=True)) == wanted
    assert texts(page, f"{table} [role=status]") == [f"{len(wanted)} of 9 points; {len(wanted)} shown."]


def test_a_name_that_there_is_not_is_said(page):
    table = opened(page, "regimes")
    box = one(page, f"{table} input")
    box.send_keys("nu > 0.2")
    (said,) = texts(page, f"{table} [role=status]")
    assert re.fullmatch(
        r"there is no column nu; there are V, mu, .*; all are shown. 9 of 9 points; 9 shown.", said
    )
    assert box.get_attribute("aria-invalid") == "true"


def test_a_long_table_is_shown_in_parts(page):
    table = opened(page, "fig5")
    assert len(column(page, table, "mu")) == 25
    one(page, f"{table} > button").click()
    assert len(column(page, table, "mu")) == 51
    assert not one(page, f"{table} > button").is_displayed()


def test_pointing_at_a_cell_tells_its_scene_its_figures_and_its_lines(page):
    moved_to(page, "regimes", 0.1, 0.1)
    told, lines = cell(page, "regimes")
    assert (told["V / mm/s"], told["μ"], told["θ / °"], told["F / N"]) == ("1", "0.05", "5", "9")
    assert told["regime"] == "steady sliding"
    moved_to(page, "regimes", 0.9, 0.9)
    told, lines = cell(page, "regimes")
    assert (told["V / mm/s"], told["μ"]) == ("5", "0.3")
    assert told["regime"] != "steady sliding"
    assert lines[0].startswith("fiv run regimes --set V=0.005 --set mu=0.3 --set theta=5 --set F=9 ")
    assert re.search(r"fiv run scenes .* --set duration=0\.\d+ ", lines[1])
    assert "simulate(Scene(V=0.005, theta=5, mu=0.3, F=9), duration=0." in lines[2]
    # The table says the same of the point.
    table = opened(page, "regimes")
    one(page, f"{table} input").send_keys("V == 0.005 and mu == 0.3")
    assert [f"{value:g} m s-1" for value in column(page, table, "velocity_rms")] == [told["velocity_rms"]]


def test_arrow_keys_move_over_the_map(page):
    from selenium.webdriver import Keys

    picture = one(page, "#regimes canvas")
    assert cell(page, "regimes")[0]["μ"] == "0.2"
    picture.send_keys(Keys.ARROW_UP)
    assert cell(page, "regimes")[0]["μ"] == "0.3"
    picture.send_keys(Keys.ARROW_UP, Keys.ARROW_LEFT)
    told = cell(page, "regimes")[0]
    assert (told["V / mm/s"], told["μ"]) == ("1", "0.3")
    assert texts(page, "#regimes .said") == [f"V / mm/s 1 μ 0.3 θ / ° 5 F / N 9; regime: {told['regime']}"]


def test_a_click_holds_the_cell_and_another_lets_go(page):
    moved_to(page, "regimes", 0.1, 0.1).click()
    # Selenium clicks in the middle.
    held = cell(page, "regimes")[0]["V / mm/s"]
    moved_to(page, "regimes", 0.9, 0.9)
    assert cell(page, "regimes")[0]["V / mm/s"] == held == "2"
    one(page, "#regimes canvas").click()
    moved_to(page, "regimes", 0.9, 0.9)
    assert cell(page, "regimes")[0]["V / mm/s"] == "5"


def test_a_touch_tells_the_cell(page):
    resize(page, 390, 844, mobile=True)
    picture = one(page, "#regimes canvas")
    page.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", picture)
    box = page.execute_script(
        "const r = arguments[0].getBoundingClientRect(); return [r.x, r.y, r.width]", picture
    )
    page.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    touch = {"x": box[0] + box[2] - 20, "y": box[1] + 20}
    page.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [touch]})
    page.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    page.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    told = cell(page, "regimes")[0]
    assert (told["V / mm/s"], told["μ"]) == ("5", "0.3")


def test_the_map_is_drawn_in_the_colours_of_its_legend(page):
    drawn = """
        const canvas = document.querySelector(arguments[0]);
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", {willReadFrequently: true});
        copy.drawImage(canvas, 0, 0);
        const found = copy.getImageData(0, 0, canvas.width, canvas.height).data;
        const seen = new Set();
        for (let k = 0; k < found.length; k += 4) seen.add(found.slice(k, k + 3).join());
        return [...seen];
    """
    swatch = "return getComputedStyle(document.querySelector(arguments[0])).backgroundColor"
    words = texts(page, "#regimes .legend span")
    assert "steady sliding" in words
    seen = page.execute_script(drawn, "#regimes canvas")
    for k in range(len(words)):
        colour = page.execute_script(swatch, f"#regimes .legend span:nth-child({k + 1}) i")
        assert ",".join(re.findall(r"\d+", colour)) in seen
    # Another figure has other colours.
    from selenium.webdriver.support.ui import Select

    Select(one(page, "#regimes .choose select")).select_by_visible_text("velocity_rms")
    assert set(page.execute_script(drawn, "#regimes canvas")) != set(seen)
    assert "m s-1" in texts(page, "#regimes .legend")[0]


def test_other_axes_are_chosen_beside_the_map(page):
    from selenium.webdriver.support.ui import Select

    selects = page.find_elements("css selector", "#scenes .choose select")
    assert len(selects) == 3
    assert cell(page, "scenes")[0]["θ / °"] == "5"
    Select(selects[1]).select_by_visible_text("40")
    told = cell(page, "scenes")[0]
    assert (told["θ / °"], told["status"]) == ("40", "failed")
    assert "ContactError" in told["error"]


@pytest.mark.parametrize("width", [320, 390])
def test_a_phone_scrolls_only_down(page, width):
    resize(page, width, 844, mobile=True)
    for study in ("regimes", "fig5", "scenes"):
        opened(page, study)
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
    background = page.execute_script("return getComputedStyle(document.body).backgroundColor")
    shade = sum(map(int, re.findall(r"\d+", background)))
    assert (shade > 600) == (name == "light")
    opened(page, "scenes")
    assert page.execute_script(CONTRAST) == []
    # Figures stay on white.
    white = "return getComputedStyle(document.querySelector('figure img')).backgroundColor"
    assert page.execute_script(white) == "rgb(255, 255, 255)"


def test_a_print_has_figures_and_numbers_without_controls(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        shown = {css: one(page, f"#regimes {css}").is_displayed() for css in ("figure img", "table", ".facts")}
        hidden = {css: one(page, f"#regimes {css}").is_displayed() for css in (".plane", "details", ".copy")}
    finally:
        page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert set(shown.values()) == {True}
    assert set(hidden.values()) == {False}
    pdf = printed(page)
    assert pdf.startswith(b"%PDF")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 7 <= pages <= 16


def test_every_control_has_a_name_and_can_be_reached(page):
    opened(page, "scenes")
    unnamed = """
        const named = (node) => node.textContent.trim() || node.getAttribute("aria-label")
          || (node.labels && node.labels.length);
        return [...document.querySelectorAll("button, a, input, select, canvas, [tabindex]")]
          .filter((node) => !named(node)).map((node) => node.outerHTML.slice(0, 80));
    """
    assert page.execute_script(unnamed) == []
    out = "return [...document.querySelectorAll('button, a, input, select, summary')].some((n) => n.tabIndex < 0)"
    assert page.execute_script(out) is False


def test_a_line_is_copied(page):
    page.execute_cdp_cmd(
        "Browser.grantPermissions", {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]}
    )
    button = one(page, "#fig5 > .command .copy")
    button.click()
    copied = page.execute_async_script("navigator.clipboard.readText().then(arguments[0], arguments[0])")
    assert copied == "fiv run fig5 --set mu=0:0.5:51"


def test_without_a_browser_the_tests_are_skipped_and_say_why(tmp_path, monkeypatch):
    monkeypatch.setattr(chromium, "CHROMIUM", None)
    with pytest.raises(pytest.skip.Exception, match="apt-get install chromium"), browser(tmp_path):
        pass
