"""Runs of the battery: the call of a case by a method, its limits and refusals, and the checks of its result."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import fivcore
from fivcore import SEPARATION, SLIP, STICK, Normalised, Rig, Scene, State, Transient, exact, full_model, published
from studies.accuracy.settings import largest_step
from studies.motion.run import SCALED
from studies.stress.cases import DIVERGENCE, DURATION, POINT, Case

Check = tuple[float, float]  # a number and the bound that it must not exceed; NaN never passes

ERRORS = {kind.__name__: kind for kind in (ValueError, fivcore.ContactError, fivcore.DivergenceError)}
# Arguments that some edges limit; of the two numbers in V / F, V is moved.
EDGES = {"fitting step": "step", "samples": "sample_rate", "least V/F": "V", "largest V/F": "V"}
# A value beyond any limit; the word before the limit in a refusal, and how near to the limit its number must be.
FAR, WORDS, DIGITS = 1e80, ("at most", "at least", "above", "from", "to"), 5e-3
# Limits that are allowed themselves, how many steps show it, and methods that refuse the argument altogether.
ALLOWED, STEPS, WITHOUT = ("step", "least V/F", "largest V/F"), 10, {"cutoff": "paper"}
# Records are of every step, of so many from the beginning; from this duration on the mean of N is checked, s.
MOST_ROWS, LONG = 2_000_000, 1.0
# Rounding, in units of the largest force or of a copied statistic, and in what the published scheme solves for.
EPS, ROUNDING, SOLVED = float(np.finfo(float).eps), 1e-12, 1e-9
# Relative energy-balance residual: of "exact", rounding; of "fast", landing within a step, per default step.
BALANCE = {"exact": 1e-9, "fast": 0.05}
# The gap of "exact", which is rounding, in units of the compliance under the largest force; instants for it.
GAP, INSTANTS = 1e-4, 2000
# Mean of N over so many blocks: standard errors that may lie between it and F, and what the head's momentum is.
BLOCKS, DEVIATIONS, MOMENTUM = 40, 5.0, 1e-6
# What the value of each check is, for a reader; `message` is of a refusal (`not_stated`).
CHECKS = {
    "finite": "numbers that are not finite", "normal": "N below zero, in units of the largest",
    "cone": "|T| beyond mu N, in units of the largest N",
    "relaxation": "T off its relaxation towards the cone, in units of it",
    "separation": "force in separation, in units of the largest",
    "direction": "power of friction on slip, in units of the largest force and speed",
    "stick": "slip speed in stick, in units of V",
    "gap": "gap in contact or penetration, in units of the compliance under the largest force",
    "energy": "relative energy-balance residual", "mean": "mean N less F where settled, in units of F",
    "copy": "statistics of a copy off the original, in units of them",
    "record": "statistics that recording changes", "message": "what a refusal fails to state",
}  # fmt: skip


@dataclass(frozen=True)
class RunSpec:
    """One call of `fivcore.simulate`."""

    method: str
    rig: Rig
    start: Callable[..., Any] | None
    arguments: Mapping[str, Any]  # V, theta, mu and F, and arguments of `simulate`: duration, ramp and others

    def changed(self, **values: Any) -> RunSpec:
        """The same run with other arguments, or with one value at an extreme."""
        arguments = {**self.arguments}
        for name, value in values.items():
            arguments[EDGES.get(name, name)] = value * arguments["F"] if name.endswith("V/F") else value
        return replace(self, arguments=arguments)

    @cached_property
    def scene(self) -> Scene:
        """The scene; raises where the numbers make none."""
        return Scene(**{name: self.arguments[name] for name in POINT}, rig=self.rig)

    @cached_property
    def model(self) -> fivcore.ReducedModel:
        """The model that the method steps through."""
        if self.method == "paper":
            return full_model(self.rig, self.scene.drive_theta)
        return fivcore.reduced_model(self.rig, self.scene.drive_theta, **self.chosen("cutoff"))

    @property
    def step(self) -> float:
        """The method's time step, s; of "exact" the grid of its statistics."""
        default = {"paper": published.PAPER_STEP, "exact": exact.READING_STEP, "fast": self.model.default_step}
        return float(self.arguments.get("step", default[self.method]))

    @property
    def initial(self) -> Any:
        """Modal displacements, velocities and contact state; None for rest under the load."""
        return self.start and self.start(self.scene, self.model.kept)

    def chosen(self, *names: str) -> dict[str, Any]:
        """The given ones of these arguments."""
        return {name: self.arguments[name] for name in names if name in self.arguments}

    def simulate(self, **more: Any) -> Transient:
        """Simulate the run, with some arguments changed."""
        options = {name: value for name, value in self.arguments.items() if name not in POINT}
        options = {"method": self.method, "initial": self.initial, **options, **more}
        (result,) = fivcore.simulate_many([self.scene], **options)
        if isinstance(result, Exception):
            raise result
        return result

    def refusal(self, kind: type[Exception] = ValueError) -> str:
        """The message with which the method refuses the run; "" if it does not."""
        try:
            self.simulate()
        except kind as refusal:
            return str(refusal)
        return ""


def spec_of(case: Case, method: str) -> tuple[RunSpec, float]:
    """The run of a case with a method, and the value at its edge; NaN where nothing had to change."""
    arguments = {**POINT, "duration": DURATION, "ramp": 1e-3, **case.scene, **case.run}
    spec = RunSpec(method, case.rig, case.start, arguments)
    if case.slips_at:
        # The clamp has then moved by V (t - ramp / 2), after the ramp.
        distance = fivcore.slip_distance(Normalised.of(spec.scene)) * arguments["F"]
        spec = spec.changed(V=distance / (case.slips_at - 0.5 * arguments["ramp"]))
    value = case.share * LIMITS[case.edge](spec) if case.edge else np.nan
    value = np.nan if case.edge == "fitting step" and not value < published.PAPER_STEP else value
    assert np.isfinite(value) or case.edge in ("", "fitting step"), f"no limit of {case.edge} is known"
    return spec if np.isnan(value) else spec.changed(**{case.edge: value}), value


class RunData(NamedTuple):
    """One run with its records."""

    spec: RunSpec
    run: Transient  # recorded at every step, from the beginning as far as MOST_ROWS go
    summary: Mapping[str, Any]  # of the whole run, not recorded; of a long one, recorded coarsely
    long: Transient | None  # of a run of LONG or more: all of it, recorded coarsely
    original: Mapping[str, Any] | None  # of a case that is a copy of the operating point: the summary of that


def collect(spec: RunSpec, is_copy: bool = False) -> RunData:
    """Simulate a run in all variants that its checks need; statistics start at once, for short runs too."""
    duration = spec.arguments["duration"]
    rate = 1.0 / (spec.step * np.ceil(duration / (spec.step * MOST_ROWS)))
    long = spec.simulate(record=True, sample_rate=rate) if duration >= LONG else None
    summary = long.summary if long else spec.simulate(settle=0.0).summary
    run = spec.simulate(duration=min(duration, MOST_ROWS * spec.step), record=True, sample_rate=None, settle=0.0)
    original = spec.changed(**POINT).simulate(settle=0.0).summary if is_copy else None
    return RunData(spec, run, summary, long, original)


def stated(message: str, word: str) -> float:
    """The number after a word of a message; NaN without one."""
    match = re.search(rf"\b{word} ([-+]?\d+\.?\d*(?:e[-+]?\d+)?)", message)
    return float(match[1]) if match else np.nan


def _largest_step(spec: RunSpec) -> float:
    if spec.method == "paper":
        return published.largest_step(spec.model.stiffness, spec.model.damping, published.BETA2)
    return largest_step(spec.model, spec.arguments["mu"])


# How far each method can be driven: computed from its own functions, or read from its refusal.
LIMITS: dict[str, Callable[[RunSpec], float]] = {
    "step": _largest_step,
    "fitting step": lambda spec: _largest_step(spec) if spec.method == "paper" else np.nan,
    "mu": lambda of: fivcore.painleve_mu(of.rig, of.scene.drive_theta, of.method, **of.chosen("cutoff", "step")),
    "least V/F": lambda spec: stated(spec.changed(V=1.0 / FAR).refusal(), "from"),
    "largest V/F": lambda spec: stated(spec.changed(V=FAR).refusal(), "to"),
    "cutoff": lambda spec: stated(replace(spec.changed(cutoff=1.0), method="fast").refusal(), "above"),
    "samples": lambda spec: stated(spec.changed(sample_rate=1e9).refusal(), "at most"),
}


def not_stated(case: Case, spec: RunSpec, value: float, expected: str) -> dict[str, tuple[float, float]]:
    """Number of faults of a refusal: the argument or its limit is missing, or the stated limit is not allowed."""
    message = spec.refusal(ERRORS[expected])
    if not message:
        raise AssertionError(f"{spec.method} does what it should refuse with {expected}")
    wrong = float(bool(case.names) and case.names not in message)
    # Without a value nothing was driven to a limit.
    if not np.isnan(value) and spec.method != WITHOUT.get(case.edge) and expected != DIVERGENCE:
        numbers = [stated(message, word) for word in WORDS]
        near = [number for number in numbers if abs(number * case.share / value - 1.0) <= DIGITS]
        if near and case.edge in ALLOWED:
            allowed = spec.changed(**{case.edge: near[0]})
            wrong += float(bool(allowed.changed(duration=STEPS * allowed.step).refusal()))
        wrong += float(not near)
    return {"message": (wrong, 0.0)}


def evaluate(data: RunData) -> dict[str, Check]:
    """Value and bound of each check that applies."""
    spec, run, summary, method = data.spec, data.run, data.summary, data.spec.method
    series = (run.time, run.velocity_B, run.normal_force, run.tangential_force, run.slip_velocity)
    # NaN in a summary means no value; but a balance always has one.
    values = [np.asarray(value, dtype=float) for value in summary.values() if not isinstance(value, str)]
    wrong = [~np.isfinite(part) for part in series] + [np.isinf(part) for part in values]
    count = float(sum(map(np.count_nonzero, wrong)) + np.isnan(summary["energy_residual"]))
    checks = _contact_law(spec, run) | {"finite": (count, 0.0)}
    if method == "exact" and spec.model.K.any():
        checks["gap"] = _gap(spec, run), GAP
    if method != "paper":
        residual = max(float(part["energy_residual"]) for part in (run.summary, summary))
        checks["energy"] = residual, BALANCE[method]
    if data.long is not None:
        checks["mean"] = _mean(data.long, spec.arguments["F"])
    elif spec.arguments["duration"] <= MOST_ROWS * spec.step:
        same = [np.array_equal(run.summary[k], v, equal_nan=not isinstance(v, str)) for k, v in summary.items()]
        checks["record"] = float(len(same) - sum(same)), 0.0
    if data.original is not None:
        checks["copy"] = max(_off(spec, k, summary[k], v) for k, v in data.original.items()), ROUNDING
    return checks


def _contact_law(spec: RunSpec, run: Transient) -> dict[str, Check]:
    """Residuals of Signorini's and Coulomb's conditions at all steps; "paper" approaches the cone gradually."""
    N, T, slip, state = run.normal_force, run.tangential_force, run.slip_velocity, run.state
    mu, V, step = spec.scene.mu, abs(spec.arguments["V"]), spec.step
    peak = max(float(np.abs(N).max()), spec.arguments["F"])
    separated, (landing, stopping) = state == SEPARATION, np.zeros((2, len(state)), dtype=bool)
    if spec.method == "fast" and not spec.model.K.any():
        # In rigid contact the step of an impact is left out: its mean velocity may differ in sign from the next.
        # So is the step in which slip ends.
        landing[1:], stopping[1:] = separated[:-1], state[:-1] == SLIP
    slips, sticks, bound = (state == SLIP) & ~landing, (state == STICK) & ~landing & ~stopping, ROUNDING
    law = {"normal": (float(max(0.0, -N.min())) / peak, ROUNDING)}
    law["separation"] = float(max(np.abs(part[separated]).max(initial=0.0) for part in (N, T))) / peak, 0.0
    if spec.method == "paper":
        # T nears s mu N by 1 / (1 + r) a step, r = step / tau; the side s is that of the two which fits.
        places = np.flatnonzero(state[1:] == SLIP) + 1
        r, before, after, cone = step / published.TAU, T[places - 1], T[places], mu * N[places]
        up, down = (np.abs((1.0 + r) * after - before - r * s * mu * N[places]) for s in (1.0, -1.0))
        size = np.abs(after) + np.abs(before) + cone
        wrong = np.minimum(up, down) / np.where(size > 0.0, size, 1.0)
        law["relaxation"] = float(wrong.max(initial=0.0)), SOLVED
        # Once friction has the sign and the size of its law; before, it relaxes.
        slips = places[(np.abs(after) <= cone) & (np.where(up <= down, after, -after) > 0.0)]
        # Its slip speed is read off displacements that grow with the drive.
        bound += 64.0 * EPS * _moved(spec, V * float(run.time[-1])) / (step * V)
    else:
        # "exact" sums T and mu N apart, over modes that all but cancel.
        rounding = 10.0 * ROUNDING if spec.method == "exact" else ROUNDING
        law["cone"] = float(max(0.0, (np.abs(T) - mu * N).max())) / peak, rounding
    most, power = peak * float(np.abs(slip).max(initial=0.0)), (T * slip)[slips]
    law["direction"] = float(max(0.0, power.max(initial=0.0))) / most if most > 0.0 else 0.0, ROUNDING
    law["stick"] = float(np.abs(slip[sticks]).max(initial=0.0)) / V, bound
    return law


def _moved(spec: RunSpec, driven: float) -> float:
    """Displacement of the clamp plus that of the tip, m, which g_T does not exceed."""
    model, initial = spec.model, spec.initial
    moved = driven + spec.arguments["F"] * float(np.sum(np.abs(model.tangential * model.static_equilibrium)))
    if initial is not None:
        # The rigid mode's angular frequency is taken as the lowest of the others.
        omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, np.inf))
        omega = np.where(omega < np.inf, omega, omega.min())
        moved += float(np.abs(model.tangential) @ (np.abs(initial[0]) + np.abs(initial[1]) / omega))
    return float(moved)


def _gap(spec: RunSpec, run: Transient) -> float:
    """Error of "exact" by its states: p + tau p' = K^-1 (N, T) along the normal, p = -g_N; open: g_N >= -u_N."""
    model, load, first = spec.model, spec.arguments["F"], spec.initial
    at, n = np.unique(np.linspace(0, len(run.time) - 1, INSTANTS).astype(int)), len(model.normal)
    options = {"cutoff": None, **spec.chosen("cutoff", "ramp")}
    options["step"] = spec.step
    options["initial"] = first and State(first[0] / load, first[1] / load, first[2])
    q, v, u = np.split(exact.states_at(Normalised.of(spec.scene), run.time[at], **options), [n, 2 * n], axis=1)
    opening = (q + model.static_equilibrium) @ model.normal
    rate, gap = v @ model.normal, q @ model.normal + u[:, 0]
    T, N, sense = run.tangential_force / load, run.normal_force / load, float(np.sign(spec.arguments["V"]))
    across, tau = np.linalg.inv(model.K)[0], float(model.C[0, 0] / model.K[0, 0])
    balance = across[0] * N[at] + across[1] * sense * T[at] + opening + tau * rate
    wrong = np.where((run.state != SEPARATION)[at], np.abs(balance), np.maximum(-gap, 0.0))
    unit = float(across[0]) * float(N.max()) + tau * float(np.abs(rate).max())
    return float(wrong.max()) / unit if unit > 0.0 else 0.0


def _mean(run: Transient, F: float) -> Check:
    """Mean N against F where the motion has settled; the bound is the standard error over blocks."""
    first = run.summary["first_slip_time"]
    N = run.normal_force[run.time >= (0.0 if np.isnan(first) else first + 0.1)]
    blocks = np.array([block.mean() for block in np.array_split(N, BLOCKS)])
    error = float(blocks.std(ddof=1)) / np.sqrt(BLOCKS) / F
    return abs(run.summary["mean_normal_force"] / F - 1.0), DEVIATIONS * error + MOMENTUM


def _off(spec: RunSpec, name: str, value: Any, original: Any) -> float:
    """Scaled difference between a statistic of a copy and that of the original."""
    if isinstance(original, str):
        return 0.0 if value == original else np.inf
    found, expected = (np.atleast_1d(np.asarray(part, dtype=float)) for part in (value, original))
    expected = expected * (spec.arguments["F"] / POINT["F"] if name in SCALED else 1.0)
    if expected.shape != found.shape or not np.array_equal(np.isnan(expected), np.isnan(found)):
        return np.inf
    size = np.where(np.abs(expected) > 0.0, np.abs(expected), 1.0)
    return float(np.nanmax(np.abs(found - expected) / size, initial=0.0))
