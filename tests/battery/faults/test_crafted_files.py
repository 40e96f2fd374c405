"""Files that somebody made: right HDF5, JSON, TOML or CSV of another shape, and what is no file at all.

What reads them is that of `test_files.py`. A pipe that a user names as --config or --points is waited for, as by
any program, and is not tried.
"""

import json
import os
import shutil
import socket
from itertools import product

import numpy as np
import pytest

from sweeps.storage.packed import Packed, pack
from tests.battery.faults.damage import ATTRIBUTES, DEEP, HOSTILE, JSON, crafted, drawn, reshaped
from tests.battery.faults.reader import COMMANDS, CSV, FILE, NAMES, OF_HALF, PARTS, SCENE, TABLE

pytestmark = [pytest.mark.battery, pytest.mark.slow]

RESULTS, STORES, TEXTS = 150, 60, 60


def test_results(trial, rng, tried, tmp_path):
    whole = (trial.kept / FILE).read_bytes()
    for n in range(RESULTS):
        made = tmp_path / f"{n}.nc"
        case = f"{n}: {crafted(rng, made, whole)}"
        for command in [None, *COMMANDS[n % 3 :: 3]]:
            with trial.place(FILE) as path:
                trial.asked_of(path, made.read_bytes(), case, command, *NAMES)
        tried["crafted results"] += 1
    assert trial.failures == []


def of_another_shape(rng, whole):
    """A file of packed arrays with one thing else in what it says of itself, or with another array."""
    about, arrays = whole.about, whole.read(whole.names)
    if rng.random() < 0.6:
        about = about | {(name := drawn(rng, list(about))): reshaped(rng, about[name])}
        return f"{name} = {json.dumps(about[name])}", about, arrays
    name = drawn(rng, list(arrays))
    value = drawn(
        rng, [arrays[name][:1], arrays[name][:0], arrays[name][::-1], np.array(HOSTILE), np.full(9, np.nan)]
    )
    if rng.random() < 0.2:
        return f"{name} left out", about, {key: each for key, each in arrays.items() if key != name}
    return f"{name} = {value}", about, arrays | {name: value}


@pytest.mark.parametrize("kind", ["manifest", "part"])
def test_what_a_run_has_left(trial, rng, tried, kind):
    """Their check sums are right, so that their values may be others."""
    name = kind if kind == "manifest" else min(each.name for each in (trial.kept / PARTS).glob("*.part"))
    whole = Packed(trial.kept / PARTS / name)
    for n in range(STORES):
        told, about, arrays = of_another_shape(rng, whole)
        for command in [(*TABLE, "--out", "half"), *OF_HALF[n % 3 :: 3]]:
            with trial.place(f"{PARTS}/{name}") as path:
                path.write_bytes(pack(about, arrays))
                trial.ask(f"{n}: {told}", command, "tiny.nc", "tiny.parts", *NAMES)
        tried[f"crafted {kind}s of a run"] += 1
    assert trial.failures == []


def toml(rng):
    """A request in which something is of another shape."""
    content = {"study": "scenes", "record": ["state"], "axes": {"mu": [0.1]}, "settings": {"duration": 0.1}}
    content |= {"scatter": {"F": "normal:9:1"}, "samples": 4, "points": {"mu": [0.1]}, "sample_rate": 1e3}
    content = reshaped(rng, {key: content[key] for key in content if rng.random() < 0.6} | {"study": "scenes"})
    lines = (
        [f"{json.dumps(key)} = {inline(value)}" for key, value in content.items()]
        if isinstance(content, dict)
        else [str(content)]
    )
    return "\n".join(
        [*lines, drawn(rng, ["", "", "", f"axes = {DEEP}", "x" * 100_000, f"# {HOSTILE}", "[axes]\n[axes]"])]
    )


def inline(value):
    """A value as TOML has it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(inline, value))}]"
    return "1979-05-27" if value is None else json.dumps(value).replace("NaN", "nan")


def csv(rng):
    """A table with something else in one or two places."""
    rows = [line.split(",") for line in CSV.splitlines()]
    cells = [
        "",
        "nan",
        "inf",
        "1e999",
        "-1",
        "9" * 400,
        "1e-400",
        '"',
        '"a\nb"',
        HOSTILE,
        "\0",
        "٣",
        "x" * 200_000,
        DEEP,
    ]
    heads = ["mu", "", "[", "mu []", "V [kg]", "V [" + "m" * 50 + "]", "sample", "row", "status", HOSTILE]
    for _ in range(int(rng.integers(1, 3))):
        row = int(rng.integers(len(rows)))
        rows[row][int(rng.integers(4))] = drawn(rng, heads if row == 0 else cells)
    return drawn(rng, ["\n", "\r\n", "\r", "\n\n", "\n,,,\n"]).join(map(",".join, rows))


@pytest.mark.parametrize(("option", "name", "make"), [("config", "run.toml", toml), ("points", "points.csv", csv)])
def test_texts_of_a_user(trial, rng, tried, option, name, make):
    with trial.place(name) as path:
        for n in range(TEXTS):
            content = make(rng).encode(
                drawn(rng, ["utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1"]), "replace"
            )
            command = ("plan", "scenes", f"--{option}", name, "--out", "new")
            trial.asked_of(path, content, f"{n}: {content[:300]}", command, name, *SCENE)
            tried[f"crafted files of --{option}"] += 1
    assert trial.failures == []


def named(target):
    """A link to something."""
    return lambda path: path.symlink_to(target)


def socketed(path):
    """A socket, which has a short name."""
    with socket.socket(socket.AF_UNIX) as made:
        folder = os.open(path.parent, os.O_RDONLY)
        made.bind(f"/proc/self/fd/{folder}/{path.name}")
        os.close(folder)


def sparse(path):
    """A file that is said to have a terabyte."""
    with path.open("wb") as file:
        file.truncate(1 << 40)


def empty(path):
    path.touch()


def of_json(path):
    """JSON of another shape, or nested too deeply."""
    path.write_text(json.dumps([JSON[-4], ATTRIBUTES[0]]) if path.suffix == ".json" else DEEP)


KINDS = [
    os.mkdir,
    os.mkfifo,
    socketed,
    named("nowhere/at-all"),
    named("/dev/zero"),
    named("/dev/full"),
    empty,
    sparse,
]
KINDS += [of_json, lambda path: path.symlink_to(path.name)]
PLACES = {
    FILE: [None, *COMMANDS],
    "results/tiny/tiny.png": [("plot", "tiny"), ("report", "tiny"), ("run", "tiny", "-q")],
    "half/tiny/tiny.parts": OF_HALF,
    f"{PARTS}/manifest": OF_HALF,
    f"{PARTS}/progress.json": OF_HALF,
    f"{PARTS}/part": OF_HALF,
    "half/tiny/.tiny.nc.lock": OF_HALF,
    "own.py": [("list", "own.py"), ("plan", "own.py"), ("query", "own.py")],
    "run.toml": [("plan", "scenes", "--config", "run.toml")],
    "points.csv": [("plan", "scenes", "--points", "points.csv")],
}


@pytest.mark.parametrize("place", PLACES)
def test_something_else_in_the_place_of_a_file(trial, rng, tried, place):
    for kind, command in product(KINDS, PLACES[place]):
        if kind is os.mkfifo and place in ("run.toml", "points.csv"):
            continue
        with trial.place(place) as path:
            where = min(path.parent.glob("*.part")) if path.name == "part" else path
            shutil.rmtree(where, ignore_errors=True)
            where.unlink(missing_ok=True)
            kind(where)
            trial.ask(f"{kind} at {place}", command, path.name, "tiny.nc", "tiny.parts", "tiny.png", "own")
        tried["other things in the place of a file"] += command == PLACES[place][0]
    assert trial.failures == []
