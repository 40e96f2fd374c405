"""A small study: numbers, words and a row of each point, of which two fail."""

import numpy as np

from studies.study import Parameter, Study
from sweeps import Axis, Variable

WORDS = {0: "calm", 1: "wild"}


def tiny(x, gain):
    """Numbers, words and a row of each point; one fails."""
    if np.any(x == 3.0):
        raise ValueError("three is not allowed")
    return {"y": gain * x, "word": (x > 2.0).astype(int), "row": x[:, None] ** np.arange(3.0)}


def draw(data):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.0, 1.0))
    axes = figure.subplots()
    axes.plot(data["x"], data["y"])
    axes.set_title(str(data["x"].attrs["units"]))
    return figure


STUDY = Study(
    name="tiny",
    title="A small study",
    question="Does it last?",
    parameters={
        "x": Parameter(np.arange(1.0, 6.0), "m", "place"),
        "kind": Parameter(np.array(["one", "other"]), "1", "kind"),
        "gain": Parameter(2.0, "1", "gain"),
    },
    outputs={
        "y": Variable("m", "height", digits=6),
        "word": Variable("1", "word", dtype="int8", flags=WORDS),
        "row": Variable("1", "row", dims=("power",), dtype="float32"),
    },
    function=tiny,
    coords={"power": Axis([0, 1, 2])},
    summary=lambda data: iter(["nothing"]),
    figure=draw,
)
