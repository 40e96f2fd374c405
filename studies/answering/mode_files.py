"""Modes of a structure as files for other programs: NumPy's .npz, or universal files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fivcore import SlidingModes, Structure
from sweeps import InputError


def write(path: Path, form: str, own: Structure, modes: SlidingModes) -> None:
    """Write the modes with the contact open, and those of steady sliding at one mu; SI.

    Arrays of ".npz": `frequency`, `damping_ratio` (m,) of the open structure; `mu`; `sliding_frequency` and
    `growth_rate` (s,); `sliding_modal` (s, m), complex, in coordinates of those modes; where the structure keeps
    them `nodes` (k,), their numbers, `positions` (k, 3), `shapes` (k, 3, m), mass-normalised, and `sliding_shapes`
    (s, k, 3). ".uff" has positions (data set 2411), real normal modes and complex modes (55).
    """
    if form not in (".npz", ".uff", ".unv"):
        raise InputError(f"--modes: {form!r}: it must be a file that ends in .npz, .uff or .unv")
    listed = np.flatnonzero(np.isfinite(modes.frequency))
    ratio = own.damping[: len(own.frequency)] / np.maximum(4.0 * np.pi * own.frequency, 1e-300)
    ratio[own.frequency == 0.0] = 0.0
    arrays: dict[str, Any] = {"frequency": own.frequency, "damping_ratio": ratio, "mu": modes.mu}
    arrays |= {"sliding_frequency": modes.frequency[listed], "growth_rate": modes.growth_rate[listed]}
    arrays["sliding_modal"] = modes.shape[listed]
    if own.shapes is not None:
        arrays |= {"nodes": own.numbers, "positions": own.nodes, "shapes": own.shapes}
        arrays["sliding_shapes"] = own.displacement(arrays["sliding_modal"])
    if form == ".npz":
        with path.open("wb") as file:
            np.savez(file, **arrays)
        return
    try:
        import pyuff
    except ImportError:
        raise InputError('a universal file needs pyuff: pip install "fiv[uff]"') from None
    usual: dict[str, Any] = {
        "model_type": 1,
        "data_ch": 2,
        "spec_data_type": 8,
        "n_data_per_node": 3,
        "load_case": 1,
    }
    usual |= {"type": 55, "node_nums": own.numbers} | {f"id{k}": "NONE" for k in range(1, 6)}
    normal = [{"freq": f, "modal_m": 1.0, "modal_damp_vis": r} for f, r in zip(own.frequency, ratio, strict=True)]
    lam = arrays["growth_rate"] + 2j * np.pi * arrays["sliding_frequency"]
    complex_modes = [{"eig": each, "modal_a": 1.0 + 0j, "modal_b": 1.0 + 0j} for each in lam]
    zero = dict.fromkeys(("def_cs", "disp_cs", "color"), 0 * own.numbers)
    sets = [{"type": 2411, "node_nums": own.numbers, **zero, **dict(zip("xyz", own.nodes.T, strict=True))}]
    for kind, text, each, shapes in (
        (2, "contact open", normal, np.moveaxis(own.shapes, -1, 0)),
        (3, f"sliding, mu = {float(modes.mu):g}", complex_modes, arrays["sliding_shapes"]),
    ):
        for k, (values, shape) in enumerate(zip(each, shapes, strict=True), 1):
            own_set = {"analysis_type": kind, "data_type": 3 * kind - 4, "mode_n": k, "id1": text}
            rows = dict(zip(("r1", "r2", "r3"), shape.T, strict=True))
            sets.append(usual | own_set | {"modal_damp_his": 0.0} | values | rows)
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
