"""Files of a user's own structure: matrices, modes, and the TOML file that names them.

Numbers are taken as they are, so they must be in SI units. Nothing in a file is executed or unpickled.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io, sparse

from fivcore import checks
from fivcore.errors import InputError
from fivcore.jit import Array

GIVEN_ROWS = ("normal", "tangential", "load", "output", "drive")
COLUMNS = ("frequency", *GIVEN_ROWS, "damping_ratio")
MATRICES = ("mass", "stiffness", "damping")
NUMBERS = ("d1", "d2", "damping_ratio", "gap", "friction", "fmax")
NEEDS_ARRAY = "a whole matrix must be in .npz, .mat or Matrix Market's array form"
DIRECTIONS = dict(zip("123456", ("x", "y", "z", "rx", "ry", "rz"), strict=True))


def read_matrix(path: str | Path, key: str | None = None) -> tuple[sparse.csr_array, Any]:
    """Read a real square matrix and, if the format has them, node and degree of freedom of each row, else None.

    Formats: `.mat` (MATLAB up to v7) and `.npz`, with the `key` of one matrix of several; Matrix Market,
    Harwell-Boeing (RUA, RSA), lines of i, j, value (from 1) as of Abaqus' COORDINATE and CalculiX, and Abaqus'
    MATRIX INPUT, which alone has labels. One triangle of a symmetric matrix is enough, except in `.mat`, `.npz`
    and RUA. An `InputError` says what is wrong with a file.
    """
    with reading(path):
        file, labels = Path(path), None
        if (suffix := file.suffix.lower()) in (".mat", ".npz"):
            arrays = io.loadmat(file) if suffix == ".mat" else np.load(file, allow_pickle=False)
            names = [name for name in arrays if not name.startswith("__")]
            packed = suffix == ".npz" and "format" in names
            if not packed and key not in names and (key or len(names) != 1):
                raise InputError(f"key = {key!r}: it must be one of {', '.join(names)}")
            found = sparse.load_npz(file) if packed else arrays[key or names[0]]
        else:
            found, labels = _text_matrix(file)
        if hasattr(found, "check_format"):
            found.check_format(full_check=True)  # SciPy's conversions trust the indices.
        matrix, shape = sparse.csr_array(found), np.shape(found)
        if shape != shape[:1] * 2 or matrix.dtype.kind not in "biuf" or not np.isfinite(matrix.data).all():
            raise InputError(f"it has shape {shape} and type {matrix.dtype}; it must be square, real and finite")
        return matrix.astype(float), labels


def read_modes(
    path: str | Path, rows: Mapping[str, Any] | None = None, positions: Mapping[int, Array] | None = None
) -> dict[str, Any]:
    """Read mass-normalised modes as a dictionary of arrays with one value for each mode.

    A CSV file has a line for each mode, and columns frequency [Hz], normal, tangential, and optionally load,
    output, drive, damping_ratio. For a universal file (`.uff`, `.unv`; data sets 55 and 2414) `rows` says what
    these are, as in {"normal": "node 12, x"}; its shapes are divided by the square root of the modal mass, if
    given, and converted to SI from the units of data set 164. With `positions`, m, of the nodes the shapes are
    stored.
    """
    with reading(path):
        if Path(path).suffix.lower() in (".uff", ".unv"):
            return _universal(Path(path), rows or {}, positions)
        if positions:
            raise InputError("positions: its modes have no shapes at nodes; a universal file has them")
        head, *lines = Path(path).read_text("utf-8-sig").splitlines() or [""]
        heads = [re.sub(r"(?<=frequency) *\[Hz\]", "", name.strip('" ')) for name in head.split(",")]
        columns = np.loadtxt(lines or ["nan"], delimiter=",", ndmin=2).T
        if rows or len(columns) != len(set(heads)):
            wrong = f"{min(rows)} must be a column" if rows else f"{len(columns)} columns, {len(set(heads))} names"
            raise InputError(f"{wrong}; give frequency, normal, tangential, ... and below a line for each mode")
        return _numbers(dict(zip(heads, columns, strict=True)), COLUMNS, COLUMNS[:3])


def structure_arguments(path: str | Path) -> tuple[str, dict[str, Any]]:
    """Read the TOML file of a structure: the name of a constructor of `Structure`, and its keyword arguments.

    `mass`, `stiffness` and `damping` name files in its folder, or {file = ..., key = ...}. `normal`, `tangential`,
    `load`, `output` and `drive` are each an index from 0, a name like "node 845, y", a table of weights of these,
    or a text file of a vector. Names need labels: the matrices' own, `dofs_per_node`, or `nodes`, a file with a
    node and a direction for each row. In place of matrices, `modes` is a file for `read_modes`, or each table
    [[mode]] is a mode.

    `positions`, a text file with node, x, y, z, keeps the shapes of modes at nodes.

    With several contacts `normal` and `tangential` are lists, or `contacts` is a list of tables {normal,
    tangential, gap, friction}, or {pairs = [[12, 40], ...], normal = "y", tangential = "x", ...}: gaps of the
    first nodes over the second ones.
    """
    with reading(path):
        content, folder = tomllib.loads(Path(path).read_text("utf-8")), Path(path).parent
        content = _contacts(content)
        rows = {name: content[name] for name in GIVEN_ROWS if name in content}
        if "mode" in content:
            _check_names(content, ("mode", *NUMBERS[:-1]))
            checks.instance("mode", modes := content["mode"], list)
            columns = {name: [each.get(name) for each in modes] for name in {n: 0 for mode in modes for n in mode}}
            arguments = _numbers(columns, COLUMNS, COLUMNS[:3])
            arguments = {name: np.transpose(each) for name, each in arguments.items()}
        elif "modes" in content:
            _check_names(content, ("modes", *GIVEN_ROWS, *NUMBERS[:-1], "positions"))
            arguments = read_modes(_file(folder, content["modes"]), rows, _positions(content, folder))
        else:
            own = (*MATRICES, *GIVEN_ROWS, *NUMBERS, "nodes", "dofs_per_node", "positions")
            _check_names(content, own, MATRICES[:2])
            arguments = _matrices(content, rows, folder)
        _check_names(arguments, arguments, GIVEN_ROWS[:3])
        arguments |= _numbers({name: content[name] for name in NUMBERS if name in content}, NUMBERS)
        return "from_matrices" if "mass" in content else "from_modes", arguments


def _contacts(content: dict[str, Any]) -> dict[str, Any]:
    """The content with the rows, gaps and friction of its `contacts` as lists."""
    if (given := content.pop("contacts", None)) is None:
        return content
    with reading("contacts"):
        if isinstance(given, dict):
            _check_names(given, ("pairs", *GIVEN_ROWS[:2], *NUMBERS[3:5]), ("pairs", *GIVEN_ROWS[:2]))
            own = {name: given[name] for name in NUMBERS[3:5] if name in given}
            for name in GIVEN_ROWS[:2]:
                at = [[f"node {node}, {given[name]}" for node in pair] for pair in given["pairs"]]
                own[name] = [{first: 1.0, second: -1.0} for first, second in at]
        else:
            own, known = {}, (*GIVEN_ROWS[:2], *NUMBERS[3:5])
            for each in given:
                _check_names(each, known, GIVEN_ROWS[:2])
            for name in {name: 0 for each in given for name in each}:
                own[name] = [each.get(name, {"gap": 0.0}.get(name, 1.0)) for each in given]
        if twice := sorted({*own} & {*content}):
            raise InputError(f"{twice[0]} is given beside them; give it in one place")
    return content | own


@contextmanager
def reading(where: object) -> Iterator[None]:
    """Turn every error into an `InputError` that begins with `where`."""
    try:
        yield
    except InputError as problem:
        raise InputError(f"{where}: {problem}") from None
    except Exception as problem:  # noqa: BLE001 - the libraries raise anything for a damaged file
        text = getattr(problem, "strerror", None) or " ".join(str(problem).split()) or type(problem).__name__
        if "matlab v7.3" in text:
            text = "MATLAB wrote v7.3 (HDF5); save it with save(FILE, NAME, '-v7')"
        raise InputError(f"{where}: it cannot be read: {text}") from None


def _check_names(names: Collection[Any], known: Collection[str], required: Collection[str] = ()) -> None:
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 3) or list(known)[:12]
            raise InputError(f"{name}: there is none of this name; use {' or '.join(near)}")
    if missing := [name for name in required if name not in names]:
        raise InputError(f"{missing[0]}: it is missing; needed are {', '.join(required)}")


def _file(folder: Path, name: Any) -> Path:
    if not (folder / str(name)).is_file():
        _check_names([str(name)], [file.name for file in folder.iterdir() if file.is_file()])
    return folder / str(name)


def _numbers(values: Mapping[str, Any], known: Collection[str], required: Collection[str] = ()) -> dict[str, Any]:
    """Finite numbers, or arrays of them, by name."""
    _check_names(values, known, required)
    finite = partial(checks.number, allowed="a finite number", accept=np.isfinite)
    return {name: checks.array(name, value, partial(finite, name))[()] for name, value in values.items()}


def _text_matrix(path: Path) -> tuple[Any, Any]:
    """The matrix in a text file, and the labels of its rows."""
    lines = path.read_text("utf-8", errors="replace").lstrip("\ufeff\r\n\t ").splitlines()
    if lines and (banner := re.match(r"%+\s*matrixmarket\s(.*)", lines[0], re.IGNORECASE)):
        words, body = banner[1].lower().split(), [line for line in lines[1:] if line.strip() and "%" not in line]
        body = _decimal(body)
        width = 1 + 2 * ("coordinate" in words) - ("pattern" in words) + ("complex" in words)
        # At a wrong character SciPy's reader stops without an error, or crashes the process.
        if len(body) > 1 and (found := np.loadtxt(body[1:], ndmin=2).shape[1]) != width:
            raise InputError(f"its lines have {found} numbers; by its banner they must have {width}")
        content = "\n".join([f"%%MatrixMarket {' '.join(words)}", *body])
        return io.mmread(BytesIO(content.encode())), None
    labels, kind = None, lines[2][:3].upper() if len(lines) > 4 else ""
    if re.fullmatch("[RCP][SUHZR][AE]", kind):
        # Harwell-Boeing format: Duff, Grimes and Lewis, ACM Trans. Math. Software 15 (1989) 1-14.
        counts, (n, columns, entries) = [*map(int, lines[1].split()), 0], map(int, lines[2][3:].split()[:3])
        if kind not in ("RUA", "RSA") or n != columns:
            raise InputError(f"it is {kind}, {n} by {columns}; it must be RUA or RSA (real, assembled), square")
        words, start = list[str](), 4 + (counts[4] > 0)
        for count, width in zip(counts[1:4], re.findall(r"[IEDFG](\d+)", lines[3].upper()), strict=False):
            for line in lines[start : start + count]:
                # A word that is longer than a field is several fields.
                touching = max(map(len, line.split()), default=0) > int(width)
                words += re.findall(f".{{1,{width}}}", line.rstrip()) if touching else line.split()
            start += count
        numbers = np.array([float(word.upper().replace("D", "E")) for word in words])
        pointers, row, values = np.split(numbers, [n + 1, n + 1 + entries])
        row, column = row.astype(int) - 1, np.repeat(np.arange(n), np.diff(pointers.astype(int)))
    else:
        data = _decimal(line.replace(",", " ") for line in lines if line.strip() and line.lstrip()[0] not in "*%#")
        table = np.loadtxt(data, ndmin=2) if data else np.zeros((1, 1))
        if table.shape[1] == 3 and _has_size_line(table, data):
            table = table[1:]
        whole = table.shape[1] in (3, 5) and not (table[:, :-1] % 1).any()
        if not whole or (table.shape == (3, 3) and np.array_equal(table, table.T)):
            raise InputError(f"its lines are neither i, j, value nor node, dof, node, dof, value; {NEEDS_ARRAY}")
        places, values = table[:, :-1].astype(int), table[:, -1]
        # Nodes may be negative, where Abaqus makes them itself.
        if (least := places[:, -1::-2].min()) < 1:
            zero = "count rows and columns from 1, not from 0" if least == 0 else NEEDS_ARRAY
            raise InputError(f"it has a row or direction {least}; {zero}")
        if table.shape[1] == 5:
            # Sorting single integers is faster than sorting pairs.
            codes, places = np.unique(places.reshape(-1, 2) @ [2**31, 1], return_inverse=True)
            labels, places = np.stack(np.divmod(codes, 2**31), axis=1), places + 1
        row, column, n = *places.reshape(-1, 2).T - 1, places.max()
    matrix = sparse.coo_array((values, (row, column)), shape=(n, n)).tocsr()
    mirror = (matrix - sparse.diags_array(matrix.diagonal())).T
    # Where no entry has its mirror image, one triangle is stored.
    if kind != "RUA" and not (matrix != 0).multiply(mirror != 0).nnz:
        matrix = matrix + mirror
    return matrix, labels


def _decimal(lines: Iterable[str]) -> list[str]:
    """Lines of numbers with Fortran's exponents, 2.0D6, as others write them."""
    return [re.sub(r"(?<=[\d.])[dD](?=[-+]?\d)", "e", line) if "d" in line.lower() else line for line in lines]


def _has_size_line(table: Array, lines: list[str]) -> bool:
    """Whether the first line is that of a Matrix Market file: rows, columns, number of entries.

    Entries begin with their smallest row or column, so such a line is one, unless its numbers do not agree with
    those below: then this is an error.
    """
    size, entries = table[0], table[1:]
    if not len(entries) or not lines[0].split()[2].isdigit() or (entries[:, :2] > size[:2]).any():
        return False
    again = (entries[:, :2] == size[:2]).all(axis=1).any()
    if again and size[2] == len(entries):
        return True
    text = f"its first line, {' '.join(lines[0].split())}, may be the size of a matrix with {size[2]:g} entries"
    raise InputError(f"{text}, but {len(entries)} follow, or an entry; begin with a banner of Matrix Market")


def universal_file(path: Path) -> tuple[Any, Any]:
    """A universal file, opened by pyuff, and the types of its data sets."""
    try:
        import pyuff
    except ImportError:
        raise InputError('a universal file needs pyuff: pip install "fiv[uff]"') from None
    path.open("rb").close()
    return (file := pyuff.UFF(str(path))), file.get_set_types()


def _positions(content: Mapping[str, Any], folder: Path) -> dict[int, Array]:
    """Positions of nodes, m, by their numbers; {} where none are given."""
    if "positions" not in content:
        return {}
    with reading(f"positions = {checks.short(content['positions'])}"):
        file = _file(folder, content["positions"])
        table = np.loadtxt(_decimal(file.read_text("utf-8-sig").replace(",", " ").splitlines()), ndmin=2)
        if table.shape[1] not in (3, 4) or (table[:, 0] % 1).any() or not np.isfinite(table).all():
            raise InputError("its lines must be node, x, y, z")
        return {int(node): np.pad(place, (0, 3 - len(place))) for node, *place in table}


def _universal(path: Path, rows: Mapping[str, Any], positions: Mapping[int, Array] | None) -> dict[str, Any]:
    file, kinds = universal_file(path)
    sets = [file.read_sets(int(place)) for place in np.flatnonzero(np.isin(kinds, (55, 2414)))]
    modes = [mode for each in sets if (mode := _universal_mode(each)) is not None]
    if len({(tuple(mode[0]), mode[1].shape) for mode in modes}) != 1:
        text = "it must have real normal modes (data set 55 or 2414, analysis type 2), all at the same nodes"
        raise InputError(text)
    nodes, shapes, frequency, mass, ratios = (np.array(each) for each in zip(*modes, strict=True))
    shapes = shapes / np.sqrt(np.where(mass, mass, 1.0))[:, None, None]
    systems = [file.read_sets(int(place)) for place in np.flatnonzero(kinds == 164)]
    units = {(each["length"], each["force"]) for each in systems} or {(1.0, 1.0)}
    if len(units) > 1:
        raise InputError(f"its units (data set 164) differ: {units}")
    # How many units of length and of force are a metre and a newton.
    length, force = units.pop()
    shapes *= np.sqrt(force / length) * np.array([1.0] * 3 + [length] * 3)[: shapes.shape[2]]
    labels = [(node, dof) for node in nodes[0] for dof in range(1, shapes.shape[2] + 1)]
    found = {"frequency": frequency} | ({"damping_ratio": ratios} if ratios.any() else {})
    for name, given in _weights(rows, labels, len(labels), path.parent).items():
        each = given if isinstance(given, list) else [given]
        own = np.array([shapes.reshape(len(modes), -1)[:, list(row)] @ list(row.values()) for row in each])
        found[name] = own if given is each else own[0]
    if positions:
        if missing := [int(node) for node in nodes[0] if int(node) not in positions]:
            raise InputError(f"positions: node {missing[0]} is missing")
        found["node_positions"] = np.array([positions[int(node)] for node in nodes[0]])
        found |= {"node_numbers": nodes[0].astype(int), "node_shapes": shapes[..., :3].transpose(1, 2, 0)}
    return found


def _universal_mode(content: Mapping[str, Any]) -> tuple[Any, Array, float, float, float] | None:
    """Nodes, shape (nodes, directions), frequency, modal mass and damping ratio of a data set with a real mode."""
    nodal = content.get("dataset_location", 1) == 1 and content.get("result_type", 8) == 8
    if not nodal or content["analysis_type"] != 2:
        return None
    if content["type"] == 55:
        shape = np.stack([content[f"r{i}"] for i in range(1, 7) if f"r{i}" in content], axis=1)
        names = ("freq", "modal_m", "modal_damp_vis")
    else:
        shape = np.array(content["data_at_node"])
        names = ("record12_field2", "record12_field4", "record12_field5")
        if content["data_type"] > 4:
            shape = shape[:, 0::2] + 1j * shape[:, 1::2]
    frequency, mass, ratio = (float(content.get(name, 0.0)) for name in names)
    return None if shape.imag.any() else (content["node_nums"], shape.real, frequency, mass, ratio)


def _names(labels: Any) -> list[str]:
    """Names of rows by node and degree of freedom."""
    return [f"node {node}, {DIRECTIONS.get(str(dof), dof)}" for node, dof in labels]


def _weights(rows: Mapping[str, Any], labels: Any, size: int, folder: Path) -> dict[str, Any]:
    """Weights by index, of each an index, a name, a table of weights of these, or a file of a vector.

    Of the gaps of several contacts they are a list.
    """
    names = {name: i for i, name in enumerate(_names(labels))}
    found: dict[str, Any] = {name: {} for name in rows}
    for name, value in rows.items():
        if isinstance(value, list):
            found[name] = [_weights({name: each}, labels, size, folder)[name] for each in value]
            continue
        with reading(f"{name} = {checks.short(value)}"):
            if isinstance(value, str) and not value.startswith("node "):
                value = dict(enumerate(np.loadtxt(_file(folder, value), ndmin=1)))
                if len(value) != size:
                    raise InputError(f"it has {len(value)} numbers; it must have {size}")
            for place, weight in value.items() if isinstance(value, dict) else [(value, 1.0)]:
                index = names.get(str(place), int(place) if str(place).isdecimal() else -1)
                if not 0 <= index < size:
                    near = difflib.get_close_matches(str(place), names, 3) or [*names][:2] or ["set dofs_per_node"]
                    known = " or ".join([f"an index from 0 to {size - 1}", *near])
                    raise InputError(f"there is no row {place}; give {known}")
                found[name][index] = checks.number("weight", weight, "a finite number", np.isfinite)
    return found


def _matrices(content: Mapping[str, Any], rows: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The matrices and rows of a finite-element model."""
    found, own = dict[str, Any](), dict[str, Any]()
    labels: Any = ()
    for name in [name for name in MATRICES if name in content]:
        with reading(name):
            entry = content[name] if isinstance(content[name], dict) else {"file": content[name]}
            _check_names(entry, ("file", "key"), ("file",))
            found[name], own[name] = read_matrix(_file(folder, entry["file"]), entry.get("key"))
    size = found["stiffness"].shape[0]
    if labelled := [each for each in own.values() if each is not None]:
        if len(labelled) < len(own) or "nodes" in content or "dofs_per_node" in content:
            raise InputError("some matrices name their nodes; then all must, without nodes and dofs_per_node")
        # Abaqus leaves out rows without entries, as of nodes without mass.
        labels = np.unique(np.concatenate(labelled), axis=0)
        size = len(labels)
        for name, matrix in found.items():
            place = np.unique(np.concatenate([labels, own[name]]), axis=0, return_inverse=True)[1][size:]
            spread = sparse.eye_array(size, format="csc")[:, place]
            found[name] = (spread @ matrix @ spread.T).tocsr()
    elif "nodes" in content:
        text = _file(folder, content["nodes"]).read_text("utf-8").lower().replace("rot", "r")
        # CalculiX writes node.direction, alone in its line.
        text = re.sub(r"^[ \t]*(\d+)\.(\d)[ \t]*$", r"\1 \2", text, flags=re.MULTILINE)
        labels = re.findall(r"(-?\d+)[ \t,]+u?(r?[xyz]|\d+)[ \t]*$", text, re.MULTILINE)
    elif "dofs_per_node" in content:
        dofs = range(1, checks.count("dofs_per_node", content["dofs_per_node"], 6) + 1)
        labels = [(node, dof) for node in range(1, size // len(dofs) + 1) for dof in dofs]
    sizes = {name: matrix.shape[0] for name, matrix in found.items()} | {"nodes": len(labels) or size}
    if len(set(sizes.values())) > 1:
        raise InputError(f"numbers of rows differ: {sizes}; nodes or dofs_per_node must name each row")
    names = {"names": _names(labels)} if len(labels) else {}
    if positions := _positions(content, folder):
        if not names:
            raise InputError("positions: they need nodes or dofs_per_node, which name each row")
        index = {name: row for row, name in enumerate(names["names"])}
        found["node_rows"] = np.array([[index.get(f"node {node}, {x}", -1) for x in "xyz"] for node in positions])
        if found["node_rows"].max() < 0:
            raise InputError(f"positions: no row is of its nodes, such as {min(positions)}")
        found |= {"node_positions": np.array([*positions.values()]), "node_numbers": np.array([*positions])}
    return found | names | _weights(rows, labels, size, folder)
