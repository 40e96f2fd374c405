"""Statistics of `fast` beside those of the published scheme, over ensembles whose members differ by the ramp.

python -m tests.benchmarks.ensembles [--members 3] [--duration 2.4] [--out FILE] [--table] [SCENE ...]

The first four scenes and that of the aluminium P2 were looked at while the reduced model was made (the latter
for its default cut-off); the others were not. Every run is appended
to FILE as one line of JSON, and what is there already is not run again; without FILE everything is computed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fivcore import Beam, Rig, Scene, simulate

ALUMINIUM = Rig(
    Beam(0.04, 0.012, 0.0012, 200e9, 7800.0, 24),
    Beam(0.12, 0.020, 0.0030, 70e9, 2700.0, 60),
    contact_position=0.07,
    head_mass=1.5,
)
BRASS = Rig(
    Beam(0.06, 0.010, 0.0020, 185e9, 7900.0, 30),
    Beam(0.20, 0.015, 0.0040, 105e9, 8500.0, 80),
    contact_position=0.12,
    head_mass=4.0,
)
TITANIUM = Rig(
    Beam(0.045, 0.012, 0.0018, 110e9, 4430.0, 28),
    Beam(0.16, 0.018, 0.0035, 200e9, 7850.0, 80),
    contact_position=0.09,
    head_mass=2.0,
)
SHORT = Rig(
    Beam(0.030, 0.008, 0.0012, 185e9, 7900.0, 20),
    Beam(0.10, 0.012, 0.0025, 185e9, 7900.0, 60),
    contact_position=0.055,
    head_mass=1.0,
)
SCENES = {
    "1 mm/s": Scene(1e-3, 5.0, 0.20, 9.0),
    "2 mm/s": Scene(2e-3, 5.0, 0.20, 9.0),
    "3 mm/s": Scene(3e-3, 5.0, 0.20, 9.0),
    "5 mm/s": Scene(5e-3, 5.0, 0.20, 9.0),
    "theta 3": Scene(2.5e-3, 3.0, 0.18, 9.0),
    "theta 7": Scene(4e-3, 7.0, 0.25, 9.0),
    "theta 10": Scene(2e-3, 10.0, 0.30, 5.0),
    "theta 12": Scene(3e-3, 12.0, 0.35, 9.0),
    "theta 15": Scene(5e-3, 15.0, 0.40, 9.0),
    "mu 0.14, 20 N": Scene(2e-3, 5.0, 0.14, 20.0),
    "contact at 65 mm": Scene(3e-3, 6.0, 0.22, 9.0, Rig(contact_position=0.065)),
    "contact at 110 mm": Scene(2e-3, 8.0, 0.30, 9.0, Rig(contact_position=0.110)),
    "aluminium P2": Scene(3e-3, 6.0, 0.25, 6.0, ALUMINIUM),
    "brass P2": Scene(4e-3, 5.0, 0.25, 12.0, BRASS),
    "titanium P1": Scene(3e-3, 6.0, 0.28, 8.0, TITANIUM),
    "short beams": Scene(3e-3, 8.0, 0.30, 6.0, SHORT),
}
FRACTIONS = ("stick_fraction", "slip_fraction", "separation_fraction")
KEPT = (
    *FRACTIONS,
    "dominant_frequency",
    "stuck_frequency",
    "velocity_rms",
    "mean_normal_force",
    "normal_force_999",
    "slip_speed_999",
    "switches_per_second",
    "first_slip_time",
    "first_separation_time",
    "energy_residual",
    "regime",
)


def member(name: str, method: str, number: int, duration: float) -> dict[str, object]:
    """One run's figures."""
    summary = simulate(SCENES[name], duration, method, ramp=1e-3 * (1.0 + 0.013 * number)).summary
    figures = {key: summary[key] for key in KEPT}
    sticks = summary["stick_times"]
    figures["stick_times"] = [float(t) for t in sticks]
    return {"scene": name, "method": method, "member": number, "duration": duration, **figures}


def ensembles(
    names: list[str], members: int, duration: float, out: Path | None
) -> Iterator[tuple[str, list, list]]:
    """For each scene the runs of `paper` and of `fast`."""
    done = {}
    if out is not None and out.exists():
        for line in out.read_text().splitlines():
            run = json.loads(line)
            done[run["scene"], run["method"], run["member"], run["duration"]] = run
    for name in names:
        runs: dict[str, list] = {}
        for method, count in (("paper", members), ("fast", 2 * members)):
            runs[method] = []
            for number in range(count):
                run = done.get((name, method, number, duration))
                if run is None:
                    run = member(name, method, number, duration)
                    if out is not None:
                        with out.open("a") as file:
                            file.write(json.dumps(run) + "\n")
                runs[method].append(run)
        yield name, runs["paper"], runs["fast"]


def mean(runs: list, key: str) -> tuple[float, float]:
    """Mean and its standard error."""
    values = np.array([run[key] for run in runs], dtype=float)
    values = values[~np.isnan(values)]
    if not len(values):
        return float("nan"), float("nan")
    error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else float("nan")
    return float(values.mean()), float(error)


def stick_mean(runs: list) -> tuple[float, float, int]:
    """Mean long stick, its standard error over all sticks, and how many."""
    sticks = np.concatenate([np.array(run["stick_times"], dtype=float) for run in runs])
    if len(sticks) < 2:
        return float("nan"), float("nan"), len(sticks)
    return float(sticks.mean()), float(sticks.std(ddof=1) / np.sqrt(len(sticks))), len(sticks)


def compare(paper: list, fast: list) -> list[tuple[str, float, float, float]]:
    """Figure, difference, tolerance without and with two standard errors of the difference."""
    rows = []
    for key in FRACTIONS:
        (a, ea), (b, eb) = mean(paper, key), mean(fast, key)
        rows.append((key, b - a, 0.02, 0.02 + 2.0 * float(np.hypot(ea, eb))))
    for key, share in (("dominant_frequency", 0.015), ("velocity_rms", 0.10)):
        (a, ea), (b, eb) = mean(paper, key), mean(fast, key)
        rows.append((key, b / a - 1.0, share, share + 2.0 * float(np.hypot(ea, eb)) / a))
    (a, ea, na), (b, eb, nb) = stick_mean(paper), stick_mean(fast)
    # A handful of sticks at the start is no mean.
    if na >= 20 and nb >= 20:
        rows.append(("stick time", b / a - 1.0, 0.10, 0.10 + 2.0 * float(np.hypot(ea, eb)) / a))
    return rows


def row(name: str, paper: list, fast: list) -> str:
    """A row of the README's table: `paper` / `fast`, standard errors of the last digits in brackets."""
    cells = []
    for key in FRACTIONS:
        (a, ea), (b, eb) = mean(paper, key), mean(fast, key)
        cells.append(f"{a:.3f}({1e3 * ea:.0f}) / {b:.3f}({1e3 * eb:.0f})")
    line, other = mean(paper, "dominant_frequency")[0], mean(fast, "dominant_frequency")[0]
    speed, same = mean(paper, "velocity_rms")[0], mean(fast, "velocity_rms")[0]
    gaps = [
        1e3 * np.mean([run["first_separation_time"] - run["first_slip_time"] for run in runs[: len(paper)]])
        for runs in (paper, fast)
    ]
    return (
        f"| {name} | {' | '.join(cells)} | {line:.0f} / {other:.0f} | {1e3 * speed:.2f} / {1e3 * same:.2f}"
        f" | {gaps[0]:.2f} / {gaps[1]:.2f} |"
    )


def main() -> None:
    """Print the figures of every scene, or the README's table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--members", type=int, default=3)
    parser.add_argument("--duration", type=float, default=2.4)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", action="store_true", help="print the table of the README")
    given = parser.parse_args()
    if given.table:
        print("| scene | stick | slip | separation | line, Hz | RMS, mm/s | slip to separation, ms |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, paper, fast in ensembles(given.scenes, given.members, given.duration, given.out):
        if given.table:
            print(row(name, paper, fast), flush=True)
            continue
        parts = [
            f"{key.split('_')[0]} {mean(paper, key)[0]:.3f}({mean(paper, key)[1] * 1e3:.0f})"
            f" {mean(fast, key)[0]:.3f}({mean(fast, key)[1] * 1e3:.0f})"
            for key in FRACTIONS
        ]
        print(f"{name:18s} paper, fast: {'; '.join(parts)}")
        for key, difference, bare, allowed in compare(paper, fast):
            verdict = (
                "within" if abs(difference) <= bare else "with 2 s.e." if abs(difference) <= allowed else "OUT"
            )
            print(f"{'':18s} {key:22s} {difference:+.4f}  of {bare:g} ({allowed:.4f})  {verdict}")
        for key in ("normal_force_999", "slip_speed_999", "switches_per_second"):
            print(f"{'':18s} {key:22s} {mean(paper, key)[0]:.5g} {mean(fast, key)[0]:.5g}", flush=True)


if __name__ == "__main__":
    main()
