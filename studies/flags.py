"""Words for the codes of a result that is not finished: its file has them only when it is whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

# Computed by studies as codes, and told as words by what they derive at the end.
CODED = ("regime", "member_regime", "state", "long_stick", "came", "passed")


def with_words(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset, its codes told as the studies tell them; what is told already stays."""
    from studies.registry import NAMES, UNLISTED

    bare = [name for name in CODED if name in dataset and "flag_meanings" not in dataset[name].attrs]
    if not bare or dataset.attrs.get("sweep") not in (*NAMES, *UNLISTED):
        return dataset
    from studies import transients

    words: dict[str, Sequence[str]] = {
        "regime": transients.REGIMES,
        "member_regime": transients.REGIMES,
        "state": transients.STATES,
        "long_stick": ("no", "yes"),
        "passed": ("no", "yes"),
    }
    if "came" in bare:
        from studies.stress_case import CAME

        words["came"] = CAME[:-1]
    return transients.with_flags(dataset, **{name: words[name] for name in bare})
