"""The accessor `.fiv` of datasets: rows, summary, figure, scenes and rigs of a result."""

import warnings
from collections.abc import Collection, Mapping
from numbers import Real
from os import PathLike
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Rig, Scene
from studies import runner
from studies.answering import summary
from studies.declaring.parameters import FRICTION, RIG, SCENE
from studies.declaring.spec import nearest
from studies.motion.scenes import scene_of
from studies.query.query import select
from sweeps import InputError


@xr.register_dataset_accessor("fiv")  # type: ignore[no-untyped-call]
class Accessor:
    """Rows, summary, figure, scenes and rigs of a result, or of a part of one."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def query(self, where: str | None = None, **options: Any) -> pd.DataFrame:
        """Rows as a frame, like ``fiv query``; options as in `studies.query.query.select`."""
        notes: list[str] = []
        frame = select(self._dataset, where, **options, note=notes.append)
        for note in notes:
            warnings.warn(note, stacklevel=2)
        return frame

    def summary(self) -> str:
        """The study's summary, as ``fiv run`` prints it."""
        return summary.text(summary.parts(runner.study_of(self._dataset), self._dataset))

    def plot(
        self,
        width: float | str | None = None,
        title: bool = True,
        font: str | None = None,
        style: str | PathLike[str] | None = None,
    ) -> Any:
        """The study's figure, a `matplotlib.figure.Figure`, as ``fiv plot`` draws it.

        `width` is in m, or text like "88mm"; `font` is a family or a font file; `style` is a style sheet of
        Matplotlib, by its name or file.
        """
        look: dict[str, Any] = {"width": width, "font": font, "sheet": style}
        return runner.draw(runner.study_of(self._dataset), self._dataset, title=title, **look)[""]

    def scene(self, **at: float | str) -> Scene:
        """The scene at the values `at` of axes, or at the nearest ones: ``data.fiv.scene(V=2e-3)``."""
        # A file without any parameter of friction is of friction that does not fall.
        law = FRICTION if not FRICTION.keys().isdisjoint(self._dataset.coords) else {}
        return scene_of(_numbers(self._dataset, [*SCENE, *RIG, *law], at))

    def rig(self, **at: float | str) -> Rig:
        """The rig at these values."""
        return Rig.of(**_numbers(self._dataset, RIG, at))


def _numbers(dataset: xr.Dataset, names: Collection[str], at: Mapping[str, float | str]) -> dict[str, Any]:
    """Numbers of a point, which must all be in the file, and its law of friction."""
    axes = {str(name): array for name, array in dataset.coords.items() if array.dtype.kind in "iuf"}
    axes |= {name: dataset[name].astype(str) for name in FRICTION if name in dataset.coords and name not in axes}
    for name, number in at.items():
        word = name in axes and axes[name].dtype.kind == "U"
        if name not in axes or not isinstance(number, str if word else Real):
            raise InputError(f"{name} = {number!r}: it must be one number of an axis; these are {', '.join(axes)}")
        value, is_near = (number, number in axes[name]) if word else nearest(axes[name], float(number))
        if not is_near:
            raise InputError(f"{name} = {number}: the result has no such value; the nearest is {value}")
        dataset = dataset.isel({dim: np.flatnonzero(dataset[name] == value) for dim in dataset[name].dims})
    for name in names:
        if name not in axes:
            raise InputError(f"{name}: it is not in the file, so the scene of the point is unknown")
        if np.unique(dataset[name]).size != 1:
            raise InputError(f"{name}: give one of its values, like {name}={dataset[name].values.flat[0]}")
    return {name: np.unique(dataset[name])[0].item() for name in names}
