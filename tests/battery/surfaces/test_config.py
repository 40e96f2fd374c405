"""A TOML file asks for what the options of a command line ask for; a damaged one is one line."""

import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies import config, registry, runner
from tests.battery.surfaces.commands import fiv, refusal
from tests.battery.surfaces.examples import surface

examples = surface("TOML files", times=170)
pytestmark = pytest.mark.battery

STUDY = registry.load("scenes")
# Names with the values that a file or an option may have for them, and what these are in the study's units.
AXES = {
    "V": [
        ("1e-3", [1e-3]),
        ("1mm/s", [1e-3]),
        ("1:5:3mm/s", [1e-3, 3e-3, 5e-3]),
        ("log:1e-3:0.1:3", [1e-3, 1e-2, 0.1]),
        (0.002, [2e-3]),
        ([0.004, 0.001], [1e-3, 4e-3]),
    ],
    "theta": [("5", [5.0]), ("-5:5:3", [-5.0, 0.0, 5.0]), (8, [8.0]), ([5.0, -8], [-8.0, 5.0]), ("5deg", [5.0])],
    "mu": [("0.1:0.3:3", [0.1, 0.2, 0.3]), (0.2, [0.2]), ([0.1, 0.3], [0.1, 0.3]), ("10,20%", [0.1, 0.2])],
    "F": [("9", [9.0]), (4.5, [4.5]), ("0.009kN", [9.0]), ([9, 18], [9.0, 18.0])],
}
SETTINGS = {
    "duration": [(0.1, 0.1), ("100ms", 0.1), ("0.2", 0.2)],
    "p1_length": [("60mm", 0.06), (0.06, 0.06)],
    "p2_thickness": [("4 mm", 0.004), (0.004, 0.004)],
    "d1": [(50, 50.0), ("20", 20.0)],
    "numerical_damping": [("published", "published"), ("none", "none")],
}
SCATTER = {
    "p1_thickness": [
        ("normal:1.5:0.01mm", "normal:0.0015:1e-05 from 0 to inf"),
        ("uniform:1.4e-3:1.6e-3", "uniform:0.0014:0.0016 from 0 to inf"),
    ],
    "head_mass": [("lognormal:3:0.05", "lognormal:3:0.05 from 0 to inf")],
}
KNOWN = {"axes": AXES, "settings": SETTINGS, "scatter": SCATTER}


def typed(value) -> str:
    """A value of a file as an option has it."""
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


@st.composite
def requests(draw):
    """What is asked for, as the content of a file."""
    content = {}
    for key, known in KNOWN.items():
        names = draw(st.lists(st.sampled_from(sorted(known)), unique=True, max_size=3))
        if names:
            content[key] = {name: draw(st.sampled_from(known[name]))[0] for name in names}
    if "scatter" in content:
        given = {"samples": st.integers(1, 64), "seed": st.integers(0, 9)}
        given |= {"sampling": st.sampled_from(["sobol", "latin", "random"])}
        content |= draw(st.fixed_dictionaries({}, optional=given))
    if "duration" in content.get("settings", {}) and draw(st.booleans()):
        content["record"] = draw(
            st.lists(st.sampled_from(["velocity_B", "normal_force", "state"]), min_size=1, unique=True)
        )
        if draw(st.booleans()):
            content["sample_rate"] = draw(st.sampled_from([20_000, 5e4, 1000.0]))
    return content


@st.composite
def files(draw, content):
    """The content as TOML: tables inline or under heads, keys in any order, comments between."""
    lines, heads = [], []
    keys = draw(st.permutations(sorted(content)))
    if draw(st.booleans()):
        lines.append('study = "scenes"')
    for key in keys:
        value = content[key]
        comment = draw(st.sampled_from(["", "  # as measured"]))
        if not isinstance(value, dict):
            lines.append(f"{key} = {json.dumps(value)}{comment}")
        elif draw(st.booleans()):
            entries = ", ".join(f"{name} = {json.dumps(each)}" for name, each in value.items())
            lines.append(f"{key} = {{ {entries} }}{comment}")
        else:
            heads += ["", f"[{key}]{comment}", *(f"{name} = {json.dumps(each)}" for name, each in value.items())]
    return "\n".join([*lines, *heads, ""])


def options(content):
    """The content as options of a command."""
    found = [
        f"--set={name}={typed(v)}" for key in ("axes", "settings") for name, v in content.get(key, {}).items()
    ]
    found += [f"--scatter={name}={each}" for name, each in content.get("scatter", {}).items()]
    if "record" in content:
        found.append(f"--record={','.join(content['record'])}")
    names = {"samples": "samples", "seed": "seed", "sampling": "sampling", "sample_rate": "sample-rate"}
    return found + [f"--{option}={content[key]}" for key, option in names.items() if key in content]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("config")


def planned(*arguments):
    """The plan that `fiv plan` would print."""
    plans = []
    with pytest.MonkeyPatch.context() as patch:
        whole = runner.plan
        patch.setattr(runner, "plan", lambda *given, **named: plans.append(whole(*given, **named)) or plans[0])
        done = fiv(*arguments)
    return done, plans


def said(plan):
    """What a plan computes: its axes bit for bit, its constants, and what its file is to say."""
    sweep = plan.sweep
    axes = {name: axis.values.tolist() for name, axis in sweep.grid.axes.items()}
    return axes, dict(sweep.constants), plan.points, plan.distinct


def meant(content):
    """Axes, settings and distributions that are asked for, in the study's units."""
    for key in KNOWN:
        pairs = content.get(key, {}).items()
        yield {name: next(own for value, own in KNOWN[key][name] if value == each) for name, each in pairs}


@examples(20)
@given(data=st.data(), content=requests())
def test_a_file_and_options_make_one_plan(folder, data, content):
    text = data.draw(files(content))
    (folder / "run.toml").write_text(text)
    assert {key: value for key, value in tomllib.loads(text).items() if key != "study"} == content
    by_file, one = planned(folder, "plan", "scenes", "--config", "run.toml")
    by_options, other = planned(folder, "plan", "scenes", *options(content))
    assert by_file == by_options
    if by_file.code == 0:
        assert said(one[0]) == said(other[0])
        axes, settings, scatter = meant(content)
        planned_axes, constants, *_ = said(one[0])
        assert axes.items() <= planned_axes.items()
        if "rig" in constants:
            rig = constants["rig"]
            beams = {f"{beam}_{name}": v for beam in ("p1", "p2") for name, v in vars(getattr(rig, beam)).items()}
            constants |= vars(rig) | beams
        assert settings.items() <= constants.items()
        drawn = dict(one[0].sweep.grid.sampling)
        if scatter:
            how = f"{content.get('sampling', 'sobol')}, seed {content.get('seed', 0)}"
            assert drawn.pop("method").startswith(how)
            assert len(planned_axes["sample"]) == content.get("samples", 1024)
        assert drawn == scatter
    else:
        refusal(by_file)
    # A file that is written from what was read says it again.
    again = config.read(folder / "run.toml")
    (folder / "again.toml").write_text(config.toml(again))
    assert config.read(folder / "again.toml") == again


@examples(40)
@given(data=st.data(), content=requests())
def test_a_damaged_file_is_another_or_one_line(folder, data, content):
    text = data.draw(files(content))
    place = data.draw(st.integers(0, len(text)))
    letter = data.draw(st.sampled_from(["", *"\"'[]{}=,.#:- \n019_eaµ\0\\"]))
    text = text[:place] + letter + text[place + data.draw(st.integers(0, 3)) :]
    (folder / "run.toml").write_text(text)
    done, plans = planned(folder, "plan", "scenes", "--config", "run.toml")
    if done.code == 0:
        content = {key: value for key, value in tomllib.loads(text).items() if key != "study"}
        _, others = planned(folder, "plan", "scenes", *options(content))
        assert said(plans[0]) == said(others[0])
    else:
        refusal(done)
