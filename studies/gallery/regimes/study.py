"""Which regime the vibration is in at each speed and friction, by an ensemble of runs, beside linear stability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import betaincc

from fivcore import Scene, Transient, checks
from fivcore.contact.reduced import reduced_model
from fivcore.transient.published import with_numerical_damping
from fivcore.transient.steady import steady_sliding
from studies import paper
from studies.gallery.regimes.compare_linear import BELOW, with_verdicts
from studies.gallery.stability.study import largest_growth
from studies.motion import ensembles, normalised, transients
from studies.motion.jobs import Job, outcomes
from studies.rig import rig_of, rig_settings
from studies.spec import evenly, logarithmically
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

MOST_MEMBERS = 100
# A point's figure is the largest of its repeat runs; of a frequency the middle one, for the mean of two rivals is
# neither; otherwise the mean.
LARGEST = ("max_normal_force", "max_slip_speed")
MIDDLE = ("dominant_frequency", "stuck_frequency")
HOW = dict.fromkeys((f"{name}_se" for name in transients.ESTIMATED), "of the mean over repeat runs")
HOW |= dict.fromkeys(LARGEST, "largest of the repeat runs") | dict.fromkeys(MIDDLE, "of the middle repeat run")
FIGURES = tuple(name for name in transients.SUMMARY if name != "regime")
# Figures whose standard deviation over repeat runs is stored too.
SPREAD = ("stick_fraction", "velocity_rms", "dominant_frequency", "normal_force_999")


def _of(name: str, how: str, digits: int) -> Variable:
    own = transients.SUMMARY[name]
    scale = "load" if name in normalised.SCALED else ""
    return replace(own, long_name=f"{own.long_name}, {how}", dtype="float32", digits=digits, scale=scale)


def _plain(units: str, long_name: str, *dims: str) -> Variable:
    return Variable(units, long_name, dims, "float32", 6)


VARIABLES = (
    {
        "regime": replace(transients.SUMMARY["regime"], long_name="regime of most repeat runs"),
        "regime_certainty": _plain(
            "1", "probability that more than half of all runs of the scene are in this regime"
        ),
        "regime_share": _plain("1", "share of the repeat runs in a regime", "kind"),
        "member_regime": replace(
            transients.SUMMARY["regime"], long_name="regime of each repeat run", dims=("member",)
        ),
    }
    | {name: _of(name, HOW.get(name, "mean over repeat runs"), 5) for name in FIGURES}
    | {f"{name}_std": _of(name, "standard deviation over repeat runs", 4) for name in SPREAD}
    | {
        "growth_rate": _plain("s-1", f"growth rate of steady sliding's least stable mode {BELOW}"),
        "growth_frequency": _plain("Hz", f"frequency of steady sliding's least stable mode {BELOW}"),
        "unstable_modes": Variable("1", f"number of growing modes of steady sliding {BELOW}", (), "int16"),
        "model_growth_rate": _plain("s-1", "growth rate of the least stable mode of all that are simulated"),
        "model_growth_frequency": _plain("Hz", "frequency of the least stable mode of all that are simulated"),
        "duration": _plain("s", "simulated time, mean over repeat runs"),
        "loading_time": _plain("s", "time in which the drive loads a stuck contact from rest until it slips"),
    }
)


def ensemble(points: Mapping[str, Any], *, members: int, **fixed: Any) -> dict[str, Any]:
    """Regime, figures and stability of each point's normalised scene."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        scene = jobs[0].scene
        duration = np.mean([run.summary["simulated_time"] for run in runs])
        times = {"duration": duration, "loading_time": ensembles.loading_time(scene)}
        return ensemble_figures(runs) | stability(scene, fixed["cutoff"], fixed["numerical_damping"]) | times

    scenes = normalised.scenes(points, fixed["rig"])
    jobs = [ensembles.ensemble(scene, members, fixed) for scene in scenes]
    return outcomes(jobs, values, copies=True)


def ensemble_figures(runs: Sequence[Transient]) -> dict[str, Any]:
    """Figures of one scene from its repeat runs: those of `majority`, and every other over the runs that have it.

    A figure is the mean, in LARGEST the largest, in MIDDLE the lower of the middle ones, NaN where no run has one;
    a standard error is that of the mean; figures in SPREAD have a standard deviation too, `*_std`, NaN for fewer
    than two runs.
    """
    figures = ensembles.figures_of(runs)
    values: dict[str, Any] = majority(figures["regime"])
    for name in FIGURES:
        finite = figures[name][np.isfinite(figures[name])]
        how: Any = np.max if name in LARGEST else ensembles.middle if name in MIDDLE else np.mean
        how = of_mean if name.endswith("_se") else how
        values[name] = float(how(finite)) if len(finite) else np.nan
        if name in SPREAD:
            values[f"{name}_std"] = finite.std(ddof=1) if len(finite) > 1 else np.nan
    return values


def of_mean(errors: np.ndarray) -> float:
    """Standard error of the mean of the repeat runs, from that of each."""
    return float(np.sqrt(np.sum(errors**2)) / len(errors))


def majority(regimes: np.ndarray) -> dict[str, Any]:
    """The regime of most repeat runs (`studies.motion.ensembles.majority`), and how sure that is.

    The certainty is the probability, by Bayes with Jeffreys' prior, that more than half of all runs of the scene
    would be in this regime: 0.985 for 4 of 4 runs, 0.84 for 3, 0.5 for 2.
    """
    most, counts = ensembles.majority(regimes)
    inside = int(counts[most])
    return {
        "regime": most,
        "regime_certainty": float(betaincc(inside + 0.5, len(regimes) - inside + 0.5, 0.5)),
        "regime_share": counts / len(regimes),
        "member_regime": regimes,
    }


def stability(scene: Scene, cutoff: float, numerical_damping: str) -> dict[str, Any]:
    """Linear stability of steady sliding: of all modes below the band, and of the model that is run.

    The model that is run has numerical damping, or none, and modes up to its cut-off, far above the band. Which of
    those grow depends on both; but where none does and a scene vibrates all the same, it is subcritical.
    """
    theta, mu = scene.drive_theta, scene.mu
    rate, frequency, unstable = largest_growth(scene.rig, theta, mu, transients.BAND)
    values = {"growth_rate": rate, "growth_frequency": frequency, "unstable_modes": unstable}
    rig = with_numerical_damping(scene.rig, transients.METHOD, numerical_damping)
    model = reduced_model(rig, theta, cutoff or None, "absorbing")
    # Without an element only rounding holds the gap of a lasting contact: there is no such map.
    steady = steady_sliding(model, mu, model.default_step) if model.K.any() else None
    model_rate = model_frequency = np.nan
    if steady is not None and len(steady.eigenvalues):
        top = steady.eigenvalues[np.argmax(steady.eigenvalues.real)]
        model_rate, model_frequency = float(top.real), abs(float(top.imag)) / (2.0 * np.pi)
    return values | {"model_growth_rate": model_rate, "model_growth_frequency": model_frequency}


def constants_of(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, the ensemble and the settings of each repeat run."""
    rig, _ = rig_of({**settings, "theta": 0.0})
    members = checks.count("members", settings["members"], MOST_MEMBERS)
    return ensembles.shared(settings) | {"members": members, "rig": rig}


def coords(*, members: int, **_: Any) -> dict[str, Axis]:
    """The regimes, of which each has a share of the repeat runs, and these runs."""
    return {
        "kind": Axis(np.array(transients.REGIMES), long_name="regime"),
        "member": Axis(np.arange(1, members + 1), "1", "repeat run, by the ramp of the drive"),
    }


STUDY = Study(
    name="regimes",
    title="Regimes: kind of vibration over V and mu",
    question="Where does the rig slide steadily, vibrate, or stick and burst, with the published scheme's "
    "numerical damping, and does linear stability predict it?",
    paper="Sections 2 and 3.5.3, at mu = 0.2: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; by "
    "Section 3.4.2 steady sliding is unstable from mu = 0.12 on. A plane of regimes is not in it.",
    axes={
        "V": Axis(logarithmically(2e-4, 1e-2, 40), "m s-1", "velocity of P2's clamp"),
        "mu": Axis(evenly(0.01, 0.4, 40), "1", "coefficient of friction"),
        "theta": Axis(np.array([paper.THETA]), "degree", "inclination of P1"),
        "F": Axis(np.array([paper.LOAD]), "N", "load on A"),
    },
    settings={"members": Setting(1.0, "1", "number of runs of each scene; they differ by the drive's ramp")}
    # Beside the paper's regimes, and stability below 10 kHz: without that damping modes above it grow first.
    | ensembles.settings(0.3, 16.0, transients.PUBLISHED, standard_error=ensembles.KNOWN)
    | {name: each for name, each in rig_settings().items() if name != "theta"},
    function=ensemble,
    variables=VARIABLES,
    constants=constants_of,
    coords=coords,
    check=ensembles.check_grid,
    derive=with_verdicts,
    options=normalised.OPTIONS,
    draw=deferred("studies.gallery.regimes.figure:draw"),
    findings=deferred("studies.gallery.regimes.findings:findings"),
)
