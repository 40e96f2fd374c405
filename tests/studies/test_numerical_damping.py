"""Which studies have the published scheme's numerical damping, and that results say which of the two they have."""

import json

import pytest

from fivcore import Rig, critical_mu
from studies import config, registry, runner, spec
from studies.maps.maps import fixed_of, plane_of, sweep_of
from studies.motion import transients
from studies.plotting import figures
from studies.query.query import query
from studies.query.scene_at import run_options

POINT = {"V": [2e-3], "theta": [5.0], "mu": [0.2], "F": [9.0], "duration": 0.1}
SAID = {"published": "with the published scheme's numerical damping", "none": "without numerical damping"}


@pytest.mark.parametrize("name", ["fig7", "contact", "fig11", "table6", "stick_time", "regimes", "scenes"])
def test_what_stands_beside_the_paper_has_its_damping(name):
    study = registry.load(name)
    own = "none" if name == "scenes" else "published"
    assert study.sweep({}).constants["numerical_damping"] == own
    assert f"numerical_damping {own} " in study.statement()
    assert ("numerical damping" in study.question) == (own == "published")
    assert study.sweep({"numerical_damping": "none"}).constants["numerical_damping"] == "none"


@pytest.mark.parametrize("word", SAID)
def test_a_result_says_which_it_has(word, tmp_path):
    """In its configuration, its figure, its findings, and what makes it again."""
    study = registry.load("scenes")
    name, asked = spec.assignment(f"numerical_damping={word}", study.texts)
    given = POINT | {name: asked}
    data = runner.run("scenes", given, tmp_path).dataset
    assert json.loads(data.attrs["configuration"])["constants"]["numerical_damping"] == word
    assert run_options(data)["numerical_damping"] == word
    assert SAID[word] in study.report(data)
    with figures.style():
        assert SAID[word] in study.draw(data).get_suptitle()
    (tmp_path / "again.toml").write_text(config.toml(config.of_result(data)))
    again = study.sweep(config.read(tmp_path / "again.toml").values_of(study))
    assert again.constants == study.sweep(given).constants
    assert len(query(data, f"numerical_damping == '{word}'")) == 1


@pytest.mark.parametrize("value", ["newmark", ["none", "published"], 1.0])
def test_another_word_is_refused(value):
    with pytest.raises(ValueError, match=r"numerical_damping = .*: it must be one of published, none"):
        registry.load("scenes").sweep({"numerical_damping": value})


def test_a_map_is_of_the_model_as_given_unless_told():
    plane = plane_of("mu=0.2", "V=5e-3")
    assert sweep_of(plane, "regime", {}).constants["numerical_damping"] == "none"
    fixed = fixed_of(["numerical_damping=published"])
    assert sweep_of(plane, "regime", fixed).constants["numerical_damping"] == "published"
    with pytest.raises(ValueError, match="numerical_damping = 'all': it must be one of published, none"):
        sweep_of(plane, "regime", {"numerical_damping": "all"})
    with pytest.raises(ValueError, match="growth_rate does not depend on it"):
        sweep_of(plane, "growth_rate", fixed)


def test_a_map_of_the_contact_limit_has_it_too():
    sweep = sweep_of(plane_of("theta=20", "d2=1e-8"), "critical_mu", {"numerical_damping": "published"})
    found = float(sweep.plan().run("sync")["critical_mu"].squeeze())
    assert found == critical_mu(Rig(), 20.0, numerical_damping="published")
    assert found != critical_mu(Rig(), 20.0)


def test_an_older_file_does_not_say():
    assert transients.damping({}) == "numerical damping of an older version"
