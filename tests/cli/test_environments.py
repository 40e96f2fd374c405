"""Points of several environments: warned of, refused with --strict, listed in the file."""

import json
from pathlib import Path

import xarray as xr

from sweeps.fingerprint import provenance

FILE = Path("results/fig5/fig5.nc")


def test_another_environment_is_a_warning_or_with_strict_an_error(here, monkeypatch):
    assert here("run", "fig5", "--set", "mu=0.1").returncode == 0
    before, whole = provenance._version, FILE.read_bytes()
    monkeypatch.setattr(provenance, "_version", lambda name: "9.9" if name == "numpy" else before(name))
    more = ("run", "fig5", "--set", "mu=0.1,0.2")
    refused = here(*more, "--strict")
    assert refused.returncode == 2
    line = refused.stderr.splitlines()[-1]
    assert "not all points are computed in one environment: numpy " in line
    assert "-> 9.9" in line
    assert FILE.read_bytes() == whole
    assert "-> 9.9; stored points stay" in here("plan", *more[1:]).stdout
    done = here(*more)
    assert done.returncode == 0
    assert [each for each in done.stderr.splitlines() if each.startswith("fiv: ") and each.endswith("-> 9.9")]
    with xr.open_dataset(FILE) as data:
        assert [each["numpy"] == "9.9" for each in json.loads(data.attrs["environments"])] == [False, True]
