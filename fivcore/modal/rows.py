"""Checks of arguments of structures: rows over modes or degrees of freedom, nodes, contacts, damping ratios."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from fivcore import checks
from fivcore.errors import InputError
from fivcore.jit import Array


def row_of(name: str, value: Any, n: int | None) -> Array:
    """A vector of n finite numbers."""
    try:
        row = np.array(value.toarray().ravel() if sparse.issparse(value) else value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {checks.short(value)}: it must be a row of numbers") from None
    if row.ndim != 1 or not len(row) or (n is not None and len(row) != n) or not np.all(np.isfinite(row)):
        count = "one or more" if n is None else str(n)
        raise InputError(f"{name} of shape {row.shape}: it must be a row of {count} finite numbers")
    return row


def over_dofs(name: str, value: Any, n: int) -> Array:
    """A vector over the degrees of freedom, given as such or as {dof: weight}."""
    if not isinstance(value, Mapping):
        return row_of(name, value, n)
    row = np.zeros(n)
    for dof, weight in value.items():
        if not isinstance(dof, (int, np.integer)) or not 0 <= dof < n:
            raise InputError(f"{name}: degree of freedom {dof!r}: it must be from 0 to {n - 1}")
        row[dof] = checks.number(f"{name}: weight of {dof}", weight, "a finite number", lambda _: True)
    return row


def finite(name: str, value: Any) -> Array:
    """An array of finite numbers."""
    return checks.array(name, value, lambda each: checks.number(name, each, "a finite number", np.isfinite))


def checked_positions(value: Any, numbers: Any) -> tuple[Array, Any]:
    """Positions of nodes in space, (k, 3), and their numbers, (k,)."""
    nodes = finite("node_positions", value)
    if nodes.ndim != 2 or nodes.shape[1] not in (2, 3) or not len(nodes):
        raise InputError(f"node_positions of shape {nodes.shape}: it must be (k, 3) or (k, 2)")
    each = np.arange(1, len(nodes) + 1) if numbers is None else np.array(numbers)
    if each.shape != nodes.shape[:1] or each.dtype.kind not in "iu" or len(np.unique(each)) < len(each):
        raise InputError(f"node_numbers of shape {each.shape}: it must be {len(nodes)} whole numbers that differ")
    return np.pad(nodes, ((0, 0), (0, 3 - nodes.shape[1]))), each


def kept_nodes(positions: Any, numbers: Any, rows: Any, K: Any) -> tuple[Array, Any, Any, Any]:
    """Positions of nodes, numbers, degrees of freedom, (k, 3), and pairs of nodes that the stiffness connects."""
    (nodes, numbers), n = checked_positions(positions, numbers), K.shape[0]
    own, rest = divmod(n, len(nodes))
    if rows is None and rest:
        raise InputError(f"node_positions: {len(nodes)} nodes do not share {n} degrees of freedom; give node_rows")
    dofs = np.arange(n).reshape(len(nodes), own)[:, :3] if rows is None else np.asarray(rows)
    if dofs.dtype.kind not in "iu" or dofs.shape[:1] != nodes.shape[:1] or dofs.ndim != 2 or dofs.shape[1] > 3:
        raise InputError(f"node_rows of shape {dofs.shape}: it must be whole numbers, 2 or 3 for each node")
    if dofs.min() < -1 or dofs.max() >= n:
        raise InputError(f"node_rows = {dofs.min()} to {dofs.max()}: each must be from -1 to {n - 1}")
    dofs = np.pad(dofs, ((0, 0), (0, 3 - dofs.shape[1])), constant_values=-1)
    node = np.full(n + 1, -1)
    node[dofs] = np.arange(len(nodes))[:, None]
    node[-1] = -1
    pairs = np.sort(np.stack([node[each] for each in sparse.coo_array(K).coords], axis=1), axis=1)
    edges = np.unique(pairs[(pairs[:, 0] >= 0) & (pairs[:, 0] < pairs[:, 1])], axis=0)
    return nodes, numbers, dofs, edges if len(edges) < max(len(nodes) * (len(nodes) - 1) // 2, 4) else edges[:0]


def contact_rows(
    normal: Any, tangential: Any, gap: Any, friction: Any, n: int, row: Callable[[str, Any, int], Array]
) -> tuple[dict[str, Any], Array]:
    """Gap and friction of several contacts (empty for one), and the rows of all gaps, (2c, n), normal first."""
    rows = []
    for name, value in (("normal", normal), ("tangential", tangential)):
        value = value.toarray() if sparse.issparse(value) and value.shape[0] > 1 else value
        several = isinstance(value, (list, tuple, np.ndarray)) and len(value) and not np.isscalar(value[0])
        rows.append(np.stack([row(name, each, n) for each in (value if several else [value])]))
    if rows[0].shape != rows[1].shape:
        raise InputError(f"tangential of shape {rows[1].shape}: it must be {rows[0].shape}, as normal is")
    count, found = len(rows[0]), dict[str, Any]()
    for name, value, least, unit in (("gap", gap, 0.0, "m"), ("friction", friction, 1e-6, "a factor of mu")):
        within = partial(checks.between, name, low=least, high=1e6, unit=unit)
        each = checks.array(name, float(name == "friction") if value is None else value, within)
        if each.shape not in ((), (count,)):
            text = f"it must be one number or {count}, one for each contact"
            raise InputError(f"{name} of shape {each.shape}: {text}")
        found[name] = np.broadcast_to(each, (count,)).copy()
    usual = count == 1 and not found["gap"].any() and found["friction"] == 1.0
    return {} if usual else found, np.vstack(rows)


def ratios_of(value: Any, n: int) -> Array:
    """Damping ratios of n modes, (n,), from one number or n."""
    ratio = checks.array("damping_ratio", value, lambda x: checks.between("damping_ratio", x, 0.0, 10.0, "1"))
    if ratio.shape not in ((), (n,)):
        raise InputError(f"damping_ratio of shape {ratio.shape}: it must be one number or {n}, one for each mode")
    return np.broadcast_to(ratio, (n,))


def extended(ratio: Any, more: int) -> Any:
    """Extend damping ratios of each mode by `more` modes with the last ratio."""
    return np.pad(ratio, (0, max(more, 0)), mode="edge") if np.ndim(ratio) == 1 else ratio
