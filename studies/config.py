"""The request of a run as a TOML file: read for a run, and written so that it reproduces a result."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sweeps
from studies import registry, spec
from studies.study import Study, suggest
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr

# Keys of a file, with the types that their values may have and what these are called.
KEYS: dict[str, tuple[tuple[type, ...], str]] = {
    "study": ((str,), "a text"),
    "axes": ((dict,), "a table"),
    "settings": ((dict,), "a table"),
    "record": ((list,), "a list of texts"),
    "sample_rate": ((int, float), "a number"),
    "scatter": ((dict,), "a table"),
    "samples": ((int,), "a whole number"),
    "seed": ((int,), "a whole number"),
    "sampling": ((str,), "a text"),
    "points": ((str, dict), "a file or a table"),
    "scheduler": ((str,), "a text"),
    "workers": ((int,), "a whole number"),
}


@dataclass(frozen=True)
class Config:
    """The request of a run.

    Attributes
    ----------
    study : str
        Its name or file; "" if it is not given.
    axes, settings : mapping
        SPEC, a number, or a list of numbers or texts; of a setting a number, a word or SPEC.
    record : tuple of str
    sample_rate : float, optional
    scatter : mapping of str to str
        Distributions of axes and settings.
    samples, seed : int, optional
    sampling : str, optional
    points : str or mapping, optional
        A CSV file, or the columns of a table.
    scheduler : str, optional
    workers : int, optional
    """

    study: str = ""
    axes: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    record: tuple[str, ...] = ()
    sample_rate: float | None = None
    scatter: Mapping[str, str] = field(default_factory=dict)
    samples: int | None = None
    seed: int | None = None
    sampling: str | None = None
    points: str | Mapping[str, Any] | None = None
    scheduler: str | None = None
    workers: int | None = None

    def values_of(self, study: Study) -> dict[str, Any]:
        """Values of the study's axes and settings, as `Study.sweep` takes them."""
        for what, other in (("axes", "settings"), ("settings", "axes")):
            own: list[str] = list(getattr(study, what))
            for name in [name for name in getattr(self, what) if name not in own]:
                why = f"has nothing of that name there; {suggest(name, own)}there are {', '.join(own) or 'none'}"
                if name in getattr(study, other):
                    raise InputError(
                        f"{what}.{name}: of study {study.name} it is one of the {other}; write it there"
                    )
                raise InputError(f"{what}.{name}: study {study.name} {why}")
        return read_values(study, {**self.axes, **self.settings})

    @property
    def where(self) -> dict[str, Any]:
        """Where the points are, if they are no grid: arguments of `runner.plan`."""
        return {name: getattr(self, name) for name in ("scatter", "samples", "seed", "sampling", "points")}

    def over(self, other: Config) -> Config:
        """The configuration, completed by another."""
        ours = {name: value for name, value in vars(self).items() if value not in ("", (), None)}
        ours |= {"axes": {**other.axes, **self.axes}, "settings": {**other.settings, **self.settings}}
        ours["scatter"] = {**other.scatter, **self.scatter}
        if self.scheduler or self.workers:
            ours |= {"scheduler": self.scheduler, "workers": self.workers}
        return replace(other, **ours)


def read_values(study: Study, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of axes and settings, of which texts may be a SPEC."""
    check_counts(study, values)
    parsed = dict(values)
    for name, value in parsed.items():
        if isinstance(value, str):
            parsed[name] = [value] if name in study.texts else spec.parse(value, name, study.units(name))
    return parsed


def check_counts(study: Study, values: Mapping[str, Any]) -> None:
    """Refuse more points than a plan can hold before their values are made; `values` are arrays, or SPECs."""
    counts = {name: len(axis) for name, axis in study.axes.items()}
    for name, value in values.items():
        if name in counts:
            # Whatever else it may be is refused later.
            listed = value.size if isinstance(value, np.ndarray) else len(value) if isinstance(value, list) else 1
            counts[name] = spec.count(value) if isinstance(value, str) else listed
    sweeps.check_counts(counts)


def read(file: str | Path) -> Config:
    """The configuration of a TOML file; `InputError` if it is invalid."""
    try:
        content = tomllib.loads(registry.read_text(registry.expanded(file), "utf-8"))
        _check(content)
    except OSError as problem:
        raise InputError(f"--config {file}: it cannot be read: {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise InputError(f"--config {file}: it is not TOML: {problem}") from None
    except InputError as problem:
        raise InputError(f"--config {file}: {problem}") from None
    return Config(**{**content, "record": tuple(content.get("record", ()))})


def _check(content: Mapping[str, Any]) -> None:
    """Refuse keys that there are not, and values of other types than theirs."""
    for key, value in content.items():
        if key not in KEYS:
            raise InputError(
                f"{key}: there is no such key; {suggest(key, list(KEYS))}the keys are {', '.join(KEYS)}"
            )
        kinds, called = KEYS[key]
        right = isinstance(value, kinds) and not isinstance(value, bool)
        if not right or (key == "record" and not all(isinstance(each, str) for each in value)):
            raise InputError(f"{key} = {value!r}: it must be {called}")
    for name, value in content.get("scatter", {}).items():
        if not isinstance(value, str):
            raise InputError(f"scatter.{name} = {value!r}: it must be a text, like 'normal:0.2:0.02'")
    for name, value in {**content.get("axes", {}), **content.get("settings", {})}.items():
        entries = value if isinstance(value, list) else [value]
        if not all(isinstance(each, (int, float, str)) and not isinstance(each, bool) for each in entries):
            raise InputError(f"{name} = {value!r}: it must be a number, SPEC or a list")


def request(study: Study, values: Mapping[str, Any], record: tuple[str, ...], sample_rate: float | None) -> Any:
    """The request of a result besides its axes, which its file stores as JSON."""
    settings = {name: each.value for name, each in study.settings.items()}
    settings |= {name: np.asarray(values[name]).ravel()[0].item() for name in settings if name in values}
    if sample_rate is not None and "sample_rate" in settings:
        settings["sample_rate"], sample_rate = sample_rate, None
    request = {"settings": settings, "record": list(record), "sample_rate": sample_rate}
    return {name: value for name, value in request.items() if value} | dict(study.request)


def of_result(dataset: xr.Dataset, whose: str = "dataset") -> Config:
    """The configuration that makes a result again, or an `InputError` where the file has none."""
    try:
        return _of_result(dataset)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise InputError(f"{whose}: it does not say what it was asked for; maps and older files do not") from None


def _of_result(dataset: xr.Dataset) -> Config:
    configuration = json.loads(dataset.attrs["configuration"])
    # A study without settings asks for nothing besides its axes.
    request = configuration["request"] if configuration["constants"] else configuration.get("request", {})
    # Of what is drawn a file has only the names.
    _check({key: value for key, value in request.items() if key not in ("axes", "points")})
    # An axis may be within the results alone.
    names = [*configuration["axes"], *request.get("axes", ())]
    axes = {name: dataset[name].values.tolist() for name in names}
    along = dataset["status"].dims[0]
    name, request = configuration["name"], {**request, "record": tuple(request.get("record", ()))}
    request.pop("axes", None)
    drawn = [*request.get("scatter", ()), *request.get("points", ())]
    if drawn and registry.parted(name)[1]:
        # They tell how many there are, also where a file has grown.
        name = registry.parted(name)[0]
        more = {"samples": len(axes[along])} if "scatter" in request else {"points": {n: axes[n] for n in drawn}}
        request, axes = request | more, {n: values for n, values in axes.items() if n not in (along, *drawn)}
    return Config(name, axes, **request)


def toml(config: Config) -> str:
    """A configuration as TOML, every number with all its digits."""
    lines = [f"study = {json.dumps(config.study)}"]
    if config.record:
        lines.append(f"record = {json.dumps(list(config.record))}")
    if config.sample_rate is not None:
        lines.append(f"sample_rate = {config.sample_rate!r}")
    draws = {key: getattr(config, key) for key in ("samples", "seed", "sampling")}
    lines += [f"{key} = {json.dumps(value)}" for key, value in draws.items() if value is not None]
    tables = {"axes": config.axes, "settings": config.settings, "scatter": config.scatter}
    for name, values in tables.items():
        if values or name != "scatter":
            lines += ["", f"[{name}]", *(f"{key} = {_value(value)}" for key, value in values.items())]
    if isinstance(config.points, Mapping):
        # Rows are kept as they are: equal steps in one column mean nothing.
        lines += ["", "[points]", *(f"{key} = {json.dumps(value)}" for key, value in config.points.items())]
    return "\n".join(lines)


def _value(value: Any) -> str:
    """A number, a text or a list, as TOML and JSON both have them; a long list of numbers as a SPEC."""
    if isinstance(value, list) and len(value) > 5 and not isinstance(value[0], str):
        value = spec.written(value) or value
    return json.dumps(value)
