"""The repository's outcomes stand in for what nobody has run, and runs leave them as they are."""

import json
import shutil

import numpy as np
import pytest
import xarray as xr

import studies
from studies import registry, runner
from studies.comparison import compared
from studies.reference import entry
from tests import HOME
from tests.helpers.commands import written

KEPT = HOME / "results" / "reference"


@pytest.fixture
def reference(tmp_path):
    """A clone's results folder with two studies in it."""
    for name in ("fig5", "fig7"):
        shutil.copytree(KEPT / name, tmp_path / "results" / "reference" / name)
    return tmp_path / "results" / "reference"


def test_the_first_command_computes_and_says_how_far_it_is_from_the_reference(tmp_path, here, reference):
    before = {path: path.read_bytes() for path in reference.rglob("*.*")}
    done = here("run", "fig5")
    assert done.returncode == 0
    assert "to do           501" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("beside the reference: ")
    assert (tmp_path / "results" / "fig5" / "fig5.png").exists()
    # Another rig is not compared.
    assert "reference" not in here("run", "fig5", "--set", "theta=8", "--set", "mu=0.2", "--out", "there").stderr
    # Its own result is what counts now.
    assert here("query", "fig5", "--limit", "1").stderr == ""
    assert {path: path.read_bytes() for path in reference.rglob("*.*")} == before


def test_where_nothing_was_run_the_reference_stands_in(tmp_path, here, reference):
    said = "fiv: results/fig5 has no result; this is the reference, results/reference/fig5/fig5.nc\n"
    done = here("query", "fig5", "--where", "mu == 0.2", "--limit", "1")
    assert (done.returncode, done.stderr) == (0, said)
    assert here("query", "fig5", "--limit", "1", "-q").stderr == ""
    done = here("status", "fig5")
    assert done.stderr == said
    assert "state           complete" in done.stdout
    # A figure is one's own, and is drawn where a run would leave it.
    done = here("plot", "fig5", "--format", "svg")
    assert (done.stdout, done.stderr) == ("results/fig5/fig5.svg\n", said)
    done = here("report")
    assert said in done.stderr
    assert (tmp_path / "results" / "report.html").exists()
    with pytest.warns(UserWarning, match="results/fig7 has no result; this is the reference"):
        assert studies.open("fig7").sizes["V"] == 3
    # From another results folder too, and by its path without a word.
    assert "reference" in here("status", "fig5", "--out", "elsewhere").stderr
    assert here("status", "results/reference/fig5/fig5.nc").stderr == ""
    # What nobody has run and no reference has is made by a run.
    assert here("plot", "table6").stderr.endswith("make it with: fiv run table6\n")
    assert not [name for name in written(tmp_path) if name.startswith("elsewhere")]


def test_no_run_writes_into_the_reference(here, reference):
    done = here("run", "fig5", "--fresh", "--out", "results/reference")
    assert (done.returncode, done.stderr) == (
        2,
        "fiv: results/reference: runs only read the reference; choose another folder (--out)\n",
    )


def test_how_far_a_result_is_from_the_reference():
    with xr.open_dataset(KEPT / "fig5" / "fig5.nc") as file:
        kept = file.load()
    assert compared("fig5", kept, kept) == "beside the reference: no difference"
    # The last digit of what is computed from a request may differ.
    rounded = kept.copy()
    rounded.attrs["configuration"] = kept.attrs["configuration"].replace("2.9434,", "2.9434000000000005,")
    assert rounded.attrs != kept.attrs
    assert compared("fig5", rounded, kept) == "beside the reference: no difference"
    other = kept.isel(mu=slice(0, 11)).copy(deep=True)
    other["frequency"].values[3, 2] += 1e-3 * np.nanmax(kept["frequency"].isel(mu=slice(0, 11)))
    assert compared("fig5", other, kept) == (
        "beside the reference: largest differences, each in units of its largest value: frequency 0.001"
    )
    # Over a narrower range there are fewer onsets.
    assert compared("fig5", kept.isel(onset=slice(0, 2)), kept) == "beside the reference: no difference"
    assert compared("fig5", kept.assign_coords(mu=kept["mu"] + 1.0), kept) == ""
    other.attrs["configuration"] = other.attrs["configuration"].replace('"theta": 5.0', '"theta": 6.0')
    assert compared("fig5", other, kept) == ""


def test_chaotic_motion_is_compared_by_its_statistics():
    with xr.open_dataset(KEPT / "scenes" / "scenes.nc") as file:
        kept = file.load()
    other = kept.copy(deep=True)
    other["velocity_rms"] = kept["velocity_rms"] * 1.05
    other["max_normal_force"] = kept["max_normal_force"] * 9.0  # an extreme, no statistic
    assert compared("scenes", other, kept) == (
        "beside the reference: largest differences, each in units of its scatter: velocity_rms 0.2"
    )


@pytest.mark.parametrize("name", registry.NAMES)
def test_what_is_listed_is_the_studys_own(name):
    """By `python -m studies.reference`, which makes the reference, too."""
    assert registry.catalogue()[name] == json.loads(json.dumps(entry(name, KEPT)))


def test_the_reference_is_made_by_one_command(tmp_path, monkeypatch):
    from studies import reference

    monkeypatch.chdir(tmp_path)
    (tmp_path / "catalogue.json").write_text(json.dumps(registry.catalogue()))
    monkeypatch.setattr(registry, "CATALOGUE", tmp_path / "catalogue.json")
    reference.main(["table4"])
    assert written(tmp_path / "results") == ["reference/table4/table4.nc", "reference/table4/table4.png"]
    assert registry.catalogue().keys() == set(registry.NAMES)
    assert runner.open_dataset("table4").sizes["mode"] == 8
