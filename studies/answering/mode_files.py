"""Modes of a structure written to files for other programs: NumPy's .npz, or universal files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fivcore import SlidingModes, Structure
from sweeps import InputError

SUFFIXES = (".npz", ".uff", ".unv")


def check(path: Path, own: Structure) -> None:
    """Refuse a file that cannot be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: it must end in {', '.join(SUFFIXES)}")
    if path.suffix.lower() != ".npz":
        own.displacement(np.zeros(len(own.frequency)))
        try:
            import pyuff  # noqa: F401
        except ImportError:
            raise InputError('a universal file needs pyuff: pip install "fiv[uff]"') from None


def write(path: Path, own: Structure, modes: SlidingModes, form: str) -> None:
    """Write the modes with the contact open, and those of steady sliding at one mu, to a file; SI.

    Arrays of .npz: `frequency`, `damping_ratio` (m,) of the open structure; `mu`; `sliding_frequency` and
    `growth_rate` (s,); `sliding_modal` (s, m), complex, in coordinates of those modes; where the structure keeps
    them `nodes` (k,), their numbers, `positions` (k, 3), `shapes` (k, 3, m), mass-normalised, and `sliding_shapes`
    (s, k, 3). A universal file has positions (data set 2411), real normal modes and complex modes (55).
    """
    listed = np.flatnonzero(np.isfinite(modes.frequency))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(own.damping[: len(own.frequency)] / (4.0 * np.pi * own.frequency), posinf=0.0)
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
    import pyuff

    number = own.numbers
    zero = {name: 0 * number for name in ("def_cs", "disp_cs", "color")}
    sets: list[Any] = [{"type": 2411, "node_nums": number, **zero, **dict(zip("xyz", own.nodes.T, strict=True))}]
    usual = {"type": 55, "model_type": 1, "data_ch": 2, "spec_data_type": 8, "n_data_per_node": 3, "load_case": 1}
    usual |= {f"id{k}": "NONE" for k in range(1, 6)} | {"node_nums": number}
    for k, shape in enumerate(np.moveaxis(own.shapes, -1, 0)):
        of = {"id1": "contact open", "analysis_type": 2, "data_type": 2, "mode_n": k + 1, "modal_m": 1.0}
        of |= {"freq": own.frequency[k], "modal_damp_vis": ratio[k], "modal_damp_his": 0.0}
        sets.append(usual | of | _directions(shape))
    lam = arrays["growth_rate"] + 2j * np.pi * arrays["sliding_frequency"]
    for k, shape in enumerate(arrays["sliding_shapes"]):
        of = {"id1": f"sliding, mu = {float(modes.mu):g}", "analysis_type": 3, "data_type": 5, "mode_n": k + 1}
        sets.append(usual | of | {"eig": lam[k], "modal_a": 1.0 + 0j, "modal_b": 1.0 + 0j} | _directions(shape))
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


def _directions(shape: Any) -> dict[str, Any]:
    return dict(zip(("r1", "r2", "r3"), shape.T, strict=True))
