"""Command lines put together at random: an answer, or one line with its documented exit code."""

import json
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests import HOME
from tests.battery.surfaces.commands import fiv, refusal
from tests.battery.surfaces.examples import surface

examples = surface("command lines", times=80)
pytestmark = pytest.mark.battery

STUDIES = st.sampled_from(["fig5", "scenes", "table4", "regimes", "robust", "fig7"])
ANY = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
JUNK = st.one_of(
    ANY, st.sampled_from(["", "nan", "=", ":", ",", "-1", "1e999", "mu=", "--", "0", "9" * 400, "()"])
)
VALUES = st.sampled_from(
    ["0.2", "0.1,0.2", "0.1:0.3:3", "log:0.1:0.3:3", "20%", "-1", "5", "2mm/s", "published", "50mm"]
)
NAMES = st.sampled_from(["V", "theta", "mu", "F", "p1_length", "duration", "d1", "numerical_damping", "vv"])
ASSIGNED = st.builds("{}={}".format, NAMES, st.one_of(VALUES, VALUES, JUNK))
DISTRIBUTED = st.builds(
    "{}={}".format,
    NAMES,
    st.one_of(st.sampled_from(["normal:0.2:0.02", "uniform:1:2", "lognormal:1:0.1", "triangular:1:2:3mm"]), JUNK),
)


def some(known, junk=JUNK):
    """Mostly a good value."""
    return st.one_of(st.sampled_from(known), st.sampled_from(known), junk)


# What may follow each option of a command; None where nothing does.
WHAT = {
    "--set": ASSIGNED,
    "--config": some(["run.toml"]),
    "--scatter": DISTRIBUTED,
    "--samples": some(["4", "64", "0"]),
    "--seed": some(["0", "7"]),
    "--sampling": some(["sobol", "latin", "random"]),
    "--points": some(["points.csv"]),
    "--standard-error": some(["0.01", "0.1"]),
    "--out": some(["elsewhere"], st.nothing()),
    "--record": some(["velocity_B", "velocity_B,state"]),
    "--sample-rate": some(["1e4"]),
    **dict.fromkeys(["--fresh", "--retry-failed", "--strict", "-q", "--nothing"]),
}
CONDITIONS = [
    "mu > 0.2",
    "mu == 0.2 and growth_rate > 0",
    "status == 'done'",
    "mode in (1, 2)",
    "nothing == 1",
    "mu >",
    "frequency == nan",
    "(mu < 0.1 or mu > 0.4) and not growth_rate < 0",
    "regime == 'periodic'",
    "mu",
]
QUERY = {
    "--where": some(CONDITIONS),
    "--show": some(
        ["mu", "mu,frequency", "mu*2, growth_rate/frequency", "count,mean:mu", "share:mu > 0.2", "mu >"]
    ),
    "--by": some(["mu", "mode", "status"]),
    "--sort": some(["mu", "-mu", "-growth_rate,mu", "count"]),
    "--limit": some(["0", "3", "-1"]),
    "--format": some(["table", "csv", "json"]),
    **dict.fromkeys(["--units", "-q"]),
}


@st.composite
def lines(draw, command, options, targets, most=4):
    """A command with some of its options in any order, each once or twice."""
    chosen = draw(st.lists(st.sampled_from(sorted(options)), max_size=most))
    words = [[name] if options[name] is None else [name, draw(options[name])] for name in chosen]
    words.insert(draw(st.integers(0, len(words))), [draw(targets)])
    return [command, *(word for part in words for word in part)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a file of each kind lies, and nothing else."""
    path = tmp_path_factory.mktemp("commands")
    (path / "run.toml").write_text('axes = { mu = "0.1:0.3:3" }\n')
    (path / "points.csv").write_text("mu,p1_length [mm]\n0.1,50\n0.2,60\n")
    return path


def ended(done, codes=(0, 2)):
    """How a command ended, which must be documented, without a traceback."""
    assert done.code in codes, done
    assert "Traceback" not in done.err
    if done.code == 2:
        refusal(done)
    return done


PLAN = lines("plan", WHAT, st.one_of(STUDIES, STUDIES, STUDIES, JUNK))


@examples(50)
@given(line=PLAN)
@example(line=["plan", "--help"])
@example(line=["plan", "scenes", "--points", "points.csv", "--set", "V=2mm/s"])
@example(line=["plan", "scenes", "--scatter", "mu=lognormal:1:230"])
def test_a_plan_is_shown_or_refused_and_writes_nothing(folder, line):
    done = ended(fiv(folder, *line))
    if done.code == 0 and "--help" not in line:
        report = dict(
            row.split(maxsplit=1) for row in done.out.splitlines() if row.split()[0] in ("points", "skipped")
        )
        assert int(report["points"]) > 0
    assert sorted(each.name for each in folder.iterdir()) == ["points.csv", "run.toml"]


FIG5 = str(HOME / "results" / "reference" / "fig5" / "fig5.nc")


@examples(60)
@given(line=lines("query", QUERY, st.just(FIG5)))
@example(line=["query", FIG5, "--by", "mu", "--show", "count,mean:frequency", "--format", "json"])
def test_a_query_has_its_rows_or_is_refused(folder, line):
    done = ended(fiv(folder, *line))
    # The last option of a name is the one that counts.
    given = dict(pairwise(line))
    if done.code == 0 and given.get("--format") == "json":
        rows = json.loads(done.out)
        rows = rows["rows"] if isinstance(rows, dict) else rows
        assert len(rows) <= int(given.get("--limit", len(rows)))
    elif done.code == 0 and given.get("--format") == "csv":
        assert len(done.out.splitlines()) - 1 <= int(given.get("--limit", 10**9))


@examples(20)
@given(
    command=st.sampled_from(["status", "plot", "list", "query"]),
    words=st.lists(st.one_of(STUDIES, JUNK), max_size=3),
)
@example(command="status", words=["fig5"])
def test_a_result_that_is_not_there_is_refused(folder, command, words):
    """Nothing lies in the folder that is named; a list needs none."""
    done = ended(fiv(folder, command, *([] if command == "list" else ["--out", "nowhere"]), *words))
    assert done.code == 2 or (command == "list" and done.out)
