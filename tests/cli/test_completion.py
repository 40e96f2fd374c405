"""What a shell offers at the tab key, and what `fiv` prints for it."""

import shutil
import subprocess

import pytest
from click.shell_completion import ShellComplete

from studies import registry
from studies.cli.completion import SHELLS, script
from studies.cli.main import fiv
from studies.maps.quantities import QUANTITIES
from tests import HOME


def offered(*words):
    """For the last of the words, which is begun."""
    *before, begun = words
    return [item.value for item in ShellComplete(fiv, {}, "fiv", "_FIV_COMPLETE").get_completions(before, begun)]


@pytest.fixture(autouse=True)
def results(monkeypatch):
    monkeypatch.setenv("FIV_RESULTS", str(HOME / "results" / "reference"))


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["run", "fig"], ["fig5", "fig6", "fig7", "fig11"]),
        (["run", "fig5", "--set", "m"], ["mu="]),
        (["run", "fig5", "--set", "p1_l"], ["p1_length="]),
        (["plan", "scenes", "--record", "velocity_B,n"], ["velocity_B,normal_force"]),
        (["map", "--x", "th"], ["theta="]),
        (["map", "--quantity", "growth"], [name for name in QUANTITIES if name.startswith("growth")]),
        (["query", "table6", "--show", "theta,dom"], ["theta,dominant_frequency"]),
        (["query", "table6", "--sort", "-dom"], ["-dominant_frequency"]),
        (["query", "table6", "--sort", "-theta,dom"], ["-theta,dominant_frequency"]),
        (["query", "table6", "--sort", "theta,-dom"], ["theta,-dominant_frequency"]),
        (["query", "table6", "--limit", "3", "--sort", "-dom"], ["-dominant_frequency"]),
        (["query", "table6", "--show", "-dom"], []),
        (["query", "table6", "--by", "dom"], ["dominant_frequency"]),
        (["query", "table6", "--units", "--sor"], ["--sort"]),
        # What cannot be told is not offered.
        (["run", "nosuch", "--set", "m"], []),
        (["query", "nosuch.nc", "--show", "m"], []),
    ],
)
def test_what_is_offered(words, found):
    assert offered(*words) == found


def test_studies_or_files():
    assert offered("plot", "") == [*registry.NAMES]
    (item,) = ShellComplete(fiv, {}, "fiv", "_FIV_COMPLETE").get_completions(["plot"], "results/")
    assert (item.type, item.value) == ("file", "results/")


def test_a_file_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "figures.py").write_text("print('not offered')\nfrom studies.gallery.fig5 import STUDY\n")
    (tmp_path / "figures.txt").touch()
    assert offered("run", "fig") == ["fig5", "fig6", "fig7", "fig11", "figures.py"]
    assert offered("run", "figures.py", "--set", "m") == ["mu="]


@pytest.mark.parametrize("shell", SHELLS)
def test_the_words_of_each_shell(shell):
    words = script(fiv, shell)
    assert "_FIV_COMPLETE" in words
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not on this machine; its words were made, not read")
    subprocess.run([shell, "-n"], input=words, text=True, check=True)


def test_a_shell_that_asks_is_answered(here, monkeypatch):
    """As its own words do."""
    for name, value in (("_FIV_COMPLETE", "bash_complete"), ("COMP_WORDS", "fiv plan fig1"), ("COMP_CWORD", "2")):
        monkeypatch.setenv(name, value)
    done = here()
    assert (done.stdout, done.stderr) == ("plain,fig11\n", "")
