"""`fiv check`: an installation that is well passes, and each of its checks can fail."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from fivcore import simulate
from studies import results
from studies.check import installation as check
from sweeps import Plan, Store
from tests import HOME
from tests.helpers.commands import written


def verdicts(done) -> list[str]:
    return [line.split()[-1] for line in done.stdout.splitlines()[1:-1]]


@pytest.mark.slow
def test_an_installation_that_is_well_passes_and_nothing_is_left_behind(tmp_path, here):
    done = here("check")
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith("Python ")
    assert set(verdicts(done)) == {"ok"}
    assert done.stdout.splitlines()[-1] == "all is well"
    assert written(tmp_path) == []


def test_every_check_can_fail(tmp_path, here, monkeypatch):
    known = json.loads(check.KNOWN.read_text())
    known["table4"]["frequency"][7] *= 1.0 + 1e-5
    known["fig5"]["onset_mu"][0] *= 1.0 + 1e-5
    for name in ("stick", "slip", "separation"):
        known["contact"][f"{name}_fraction"][0] += 0.05
    (tmp_path / "known.json").write_text(json.dumps(known))
    monkeypatch.setattr(check, "KNOWN", tmp_path / "known.json")
    monkeypatch.setattr(check, "ENERGY", 1e-5)
    monkeypatch.setattr(check, "INK", 0.5)

    def late(scene, duration, method, **options):
        return simulate(replace(scene, mu=0.21) if method == "fast" else scene, duration, method, **options)

    monkeypatch.setattr(check, "simulate", late)
    run, opened = Plan.run, xr.open_dataset

    def changed(data):
        """A number differs by its last bit, and a point is not done."""
        data = data.load().copy(deep=True)
        rms = data["velocity_rms"].values
        rms.flat[0] = np.nextafter(rms.flat[0], 1.0)
        data["status"].values.flat[0] = 0
        return data

    def plain(file, **options):
        data = opened(file, **options)
        # Of the engine's own readers nothing is changed: these say how they read.
        return data if options else changed(data)

    def elsewhere(plan, scheduler="threads", workers=None, progress=None, **options):
        try:
            data = run(plan, scheduler, workers, progress, **options)
        finally:
            # Only the part that the check removes is left of the run that it interrupts.
            for part in sorted(Store(plan.store).parts.glob("*.part"))[1:]:
                part.unlink()
        return changed(data) if plan.store.stem in ("processes", "resumed") else data

    monkeypatch.setattr(Plan, "run", elsewhere)
    monkeypatch.setattr(xr, "open_dataset", plain)
    done = here("check")
    assert done.returncode == 1
    assert verdicts(done) == ["FAILED"] * 14, done.stdout
    assert done.stdout.splitlines()[-1].startswith("14 of 14 checks failed: ")


def test_an_error_is_a_check_that_failed_and_the_others_go_on(tmp_path, monkeypatch):
    def broken(folder, known):
        raise ImportError("libhdf5.so: cannot open")

    def works(folder, known):
        yield check.Found("works", "0", "0", True)

    monkeypatch.setattr(check, "stability", broken)
    for name in ("motion", "contact", "engine"):
        monkeypatch.setattr(check, name, works)
    first, *others = check.checks(tmp_path)
    assert first == ("broken", "ImportError: libhdf5.so: cannot open", "no error", False)
    assert [each.passed for each in others] == [True] * 3


def test_what_it_compares_with_is_the_reference():
    made = check.known_of(HOME / "results" / results.FOLDER)
    assert json.loads(check.KNOWN.read_text()) == made, "take it again: python -m studies.check"
