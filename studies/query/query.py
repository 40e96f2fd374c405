"""Rows of a result, one for each point: selection, order, groups, and output.

A column with a further dimension (mode, member, elapsed) makes a row of each of its values; missing values make
none, unless the condition contains nan. Only the named variables are read, and of these only the part that
conditions along one dimension select.
"""

import ast
import difflib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from studies.query.where import NUMBER, TRUTH, Evaluator, kind, names_in, parse
from sweeps import InputError

MOST_ROWS = 5_000_000
STATISTIC = re.compile(r"(size|mean|std|min|max|median|share)\s*:\s*(\S.*)")
ASIDE = re.compile(r"status|error|wall_time|growing_above_band|.*_se")  # no columns by default
# The commas of a list are outside of quotes and brackets.
ENTRY = re.compile(r"""(?:'[^']*'|"[^"]*"|\((?:[^()]|\([^()]*\))*\)|[^,])+""")
Names = str | Sequence[str] | None


def select(
    dataset: xr.Dataset,
    where: str | None = None,
    show: Names = None,
    by: Names = None,
    sort: Names = None,
    limit: int | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> pd.DataFrame:
    """Select rows of a result as a frame, with the units of columns as ``attrs["units"]``.

    Parameters
    ----------
    dataset : xarray.Dataset
    where : str, optional
        Condition on the rows (`studies.query.where`).
    show, by, sort : str or sequence of str, optional
        Columns, by name or calculated: "V*1000, mu"; to sort descending with a minus in front. Rows that agree in
        `by` are one, and `show` has "count", "share:X" of words or a condition, "mean:X", std, min, max, median.
    limit : int, optional
    note : callable
        Called with a sentence on a number that no axis has.
    """
    if limit is not None and not (isinstance(limit, (int, np.integer)) and limit >= 0):
        raise InputError(f"limit = {limit!r}: it must be a whole number, 0 or above")
    result = _Result(dataset)
    condition = result.parse("True" if where is None else where, "where")
    order = {entry.removeprefix("-").strip(): entry[0] != "-" for entry in _listed(sort, "sort")}
    keys = {entry: result.parse(entry, "by") for entry in _listed(by, "by")}
    ranks = {} if keys else {entry: result.parse(entry, "sort") for entry in order}
    named = names_in(condition, *ranks.values())
    entries = _listed(show, "show") or (["count"] if keys else result.usual(named))
    shown = {e: result.parse(_statistic(e)[1] if keys else e, "show") for e in entries if e not in keys}
    read = names_in(*keys.values(), *shown.values())
    part = result.part([*read, *named], whole=show is None or bool(keys))
    rows = result.rows(part, condition)
    chosen = pd.Series(True, rows.index) & Evaluator(rows, result.axes, "where", note)(condition, TRUTH)
    if (padded := [*result.entries.intersection(read)]) and not re.search(r"\bnan\b", where or ""):
        chosen &= ~rows[padded].isna().all(axis=1)
    rows = rows[chosen]

    def table(trees: Mapping[Any, ast.expr], argument: str) -> pd.DataFrame:
        evaluate = Evaluator(rows, result.axes, argument, note)
        return pd.DataFrame({label: evaluate(tree) for label, tree in trees.items()}, rows.index)

    frame = _grouped(table(keys, "by"), table(shown, "show")) if keys else table(ranks, "sort")
    if unknown := [entry for entry in order if entry not in frame]:
        raise InputError(f"sort = {unknown[0]!r}: the grouped table has only {', '.join(frame)}")
    if order:
        frame = frame.sort_values([*order], ascending=[*order.values()], kind="stable", na_position="last")
    frame = frame[:limit]
    if not keys:
        rows = rows.loc[frame.index]
        further = {dim: ast.Name(str(dim)) for dim in part.sizes if dim not in [*result.points, *shown]}
        frame = table(further | shown, "show")
    frame.attrs["units"] = {n: unit for n in frame if (unit := result.units.get(n.rpartition(":")[2].strip()))}
    return frame.reset_index(drop=True)


def text(frame: pd.DataFrame, form: str, units: bool = False, width: int | None = None) -> str:
    """Write rows as "table" (in blocks of a `width`), "csv" or "json"; `units` in heads or beside the rows."""
    known = frame.attrs.get("units", {})
    if form == "json":
        plain = frame.replace([np.inf, -np.inf], np.nan).astype(object)
        rows = ",\n".join(json.dumps(row) for row in plain.where(plain.notna(), None).to_dict("records"))
        rows = f"[\n{rows}\n]" if rows else "[]"
        return f'{{"units": {json.dumps(known)},\n"rows": {rows}}}\n' if units else f"{rows}\n"
    heads = [f"{label} [{known[label]}]" if units and label in known else label for label in frame]
    if form == "csv":
        return str(frame.to_csv(index=False, header=heads, lineterminator="\r\n"))
    cells = frame.map(lambda cell: f"{cell:.6g}" if isinstance(cell, float) else " ".join(str(cell).split())[:60])
    cells = cells.where(frame.notna(), "-").set_axis(heads, axis=1)
    return f"{cells.to_string(index=False, line_width=width) if len(cells) else '  '.join(heads)}\n"


def _listed(names: Names, argument: str) -> list[str]:
    text = names if isinstance(names, str) else ",".join(names or ())
    entries = [entry.strip() for entry in ENTRY.findall(text)]
    if names is not None and not all(entries or [""]):
        raise InputError(f"{argument} = {names!r}: it must be columns with commas between them, like V,mu")
    return list(dict.fromkeys(entries))


def _statistic(entry: str) -> tuple[str, str]:
    """The function and the column of a statistic such as mean:V; count is the size of a column of zeros."""
    if match := STATISTIC.fullmatch("size:0" if entry == "count" else entry):
        return match[1], match[2]
    raise InputError(f"show = {entry!r}: with by it is count, or mean, std, min, max, median or share like mean:V")


def _grouped(keys: pd.DataFrame, columns: pd.DataFrame) -> pd.DataFrame:
    """Statistics of columns over the rows with equal keys."""
    table, aggregations = keys.copy(), dict[str, tuple[int, str]]()
    for label, values in columns.items():
        function, share = _statistic(str(label))[0], str(label).startswith("share")
        words = values.cat.categories if share and hasattr(values, "cat") else []
        measures = {f"{label}={word}": values == word for word in words} or {str(label): values}
        if not len(words) and kind(values) != (TRUTH if share else NUMBER):
            raise InputError(f"show = {label!r}: it is {kind(values)}; share is of words or a condition")
        for head, measure in measures.items():
            table[len(aggregations)] = measure.astype(float)
            aggregations[head] = (len(aggregations), "mean" if share else function)
    return table.groupby([*keys], dropna=False, observed=True, as_index=False).agg(**aggregations)


class _Result:
    """Columns of a result, their units and dimensions."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset = dataset.assign_coords({d: range(n) for d, n in dataset.sizes.items() if d not in dataset})
        arrays = [dataset["status"]] if "status" in dataset else [*dataset.data_vars.values()]
        self.points = [dim for array in arrays[:1] for dim in array.dims if all(dim in a.dims for a in arrays)]
        self.entries = {name for name, array in dataset.items() if not {*array.dims} <= {*self.points}}
        coords = self.dataset.coords.items()
        self.axes: Any = {n: a.values for n, a in coords if a.ndim < 2 and a.dtype.kind in "iuf"}
        units: Any = {name: array.attrs.get("units", "1") for name, array in dataset.variables.items()}
        self.units = {name: unit for name, unit in units.items() if unit != "1"}

    def parse(self, text: str, argument: str) -> ast.expr:
        tree = ast.Name(text) if text in self.dataset.variables else parse(text, argument, self.units)
        for name in names_in(tree):
            if name not in self.dataset.variables:
                raise InputError(f"{argument} = {name!r}: no such column; {self.hint(name)}")
        return tree

    def hint(self, name: str) -> str:
        """Suggest columns with a similar name, or with the name in their description."""
        arrays: Any = {**self.dataset.coords, **self.dataset.data_vars}
        if any(name in str(array.attrs.get("flag_meanings")).split() for array in arrays.values()):
            return f"to compare with the word, write {name!r} in quotes"
        texts = {n: str(array.attrs.get("long_name", "")) for n, array in arrays.items() if not n.endswith("_se")}
        close = {n for n in texts if name in n}.union(difflib.get_close_matches(name, texts, 1))
        meant = [n if n in close else f"{n} ({texts[n]})" for n in texts if n in close or name in texts[n].split()]
        return f"did you mean {' or '.join(meant[:3])}?" if meant else f"it has {', '.join(arrays)}"

    def part(self, names: Sequence[str], whole: bool) -> xr.Dataset:
        """Some columns along the dimensions of the rows, which are those of the points where these are `whole`."""
        further = [{*self.dataset[name].dims}.difference(self.points) for name in names]
        if further and set().union(*further) not in further:
            raise InputError(f"{', '.join(names)} run along different dimensions: query one after the other")
        points = self.points if whole and self.entries.isdisjoint(names) else []
        part = self.dataset[[*dict.fromkeys([*points, *names])]]
        return part.drop_vars({*part.coords}.difference(part.sizes, names))

    def usual(self, names: Sequence[str]) -> list[Any]:
        """The default columns: the axes, variables with one value in each row, and variables named elsewhere."""
        dims, points = {*self.part(names, whole=True).sizes}, {*self.points}
        data = {n: a for n, a in self.dataset.items() if a.dtype.kind in "iufbOU" and not ASIDE.fullmatch(str(n))}
        wider = [{*array.dims} for array in data.values() if {*array.dims} >= dims]
        if dims == points and points not in wider:
            dims = wider[0] if wider else dims
        axes = [n for n, array in self.dataset.coords.items() if array.ndim and {*array.dims} <= dims]
        named = [name for name in names if self.dataset[name].ndim]
        status = ["status"] if dims == points and "status" in self.dataset else []
        return [*dict.fromkeys([*axes, *(n for n in data if {*data[n].dims} == dims), *named, *status])]

    def rows(self, part: xr.Dataset, condition: Any) -> pd.DataFrame:
        """Read the rows of a part that meet the conditions along one dimension."""
        for conjunct in condition.values if isinstance(getattr(condition, "op", 0), ast.And) else [condition]:
            line = part[names_in(conjunct)]
            if len(line.sizes) == 1:
                chosen = Evaluator(self.frame(line), self.axes, "where")(conjunct, TRUTH)
                part = part.isel({dim: np.flatnonzero(chosen) for dim in line.sizes})
        if (count := math.prod(part.sizes.values())) > MOST_ROWS:
            dim = max(part.sizes, key=part.sizes.__getitem__)
            advice = f"select along {dim}, like '{dim} == {part[dim].values[0]}', or show less"
            raise InputError(f"{count} rows are more than {MOST_ROWS}: {advice}")
        return self.frame(part)

    def frame(self, part: xr.Dataset) -> pd.DataFrame:
        """Read columns as a frame, with words as categories."""
        part = part if part.sizes else part.reset_coords().expand_dims("")
        dims = sorted(part.sizes, key=lambda dim: [*self.points, dim].index(dim))
        frame = part.to_dataframe(dim_order=dims).reset_index()
        for name, variable in part.variables.items():
            if "flag_values" in variable.attrs:
                codes = pd.Index(np.atleast_1d(variable.attrs["flag_values"])).get_indexer(frame[name])
                words = [word.replace("_", " ") for word in str(variable.attrs["flag_meanings"]).split()]
                frame[name] = pd.Categorical.from_codes(codes, words)
            elif name in self.dataset.coords and name not in self.axes:
                frame[name] = pd.Categorical(frame[name], pd.unique(np.ravel(self.dataset[name])))
        return frame
