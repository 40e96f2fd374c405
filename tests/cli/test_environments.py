"""Points computed by other versions, as the commands tell them."""

from pathlib import Path

from sweeps.fingerprint import provenance

FILE = Path("results/fig5/fig5.nc")


def test_other_versions_are_told_refused_and_queried(here, monkeypatch):
    assert here("run", "fig5", "--set", "mu=0.1").returncode == 0
    before, whole = provenance._version, FILE.read_bytes()
    monkeypatch.setattr(provenance, "_version", lambda name: "9.9" if name == "numpy" else before(name))
    more = ("run", "fig5", "--set", "mu=0.1,0.2")
    refused = here(*more, "--strict")
    assert refused.returncode == 2
    last = refused.stderr.splitlines()[-1]
    assert last.startswith("fiv: ")
    assert "not all points are computed in one environment: numpy " in last
    assert "-> 9.9" in last
    assert FILE.read_bytes() == whole
    assert "-> 9.9; what is there is kept" in here("plan", *more[1:]).stdout
    done = here(*more)
    assert done.returncode == 0
    assert [line for line in done.stderr.splitlines() if "computed_by" in line and line.startswith("fiv: ")]
    assert (
        here("query", "fig5", "--where", "computed_by == 1", "--show", "mu", "--format", "csv").stdout
        == "mu\r\n0.2\r\n"
    )
    # It is no result that is shown where nothing is asked for.
    assert "computed_by" not in here("query", "fig5").stdout
    assert here("status", "fig5").returncode == 0
    assert here("report").returncode == 0
