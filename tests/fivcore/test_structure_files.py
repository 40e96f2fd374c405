"""Files of a user's own structure: what other programs wrote is read; what is wrong is said in one line."""

import numpy as np
import pytest
import scipy.io
from scipy import linalg, sparse

from fivcore import InputError
from fivcore.structure_files import read_matrix, read_modes, structure_arguments
from tests import HOME

READERS = HOME.parent / "shared" / "data" / "readers"
shared = pytest.mark.skipif(not READERS.exists(), reason="the sample files are not part of the project")
RANDOM = np.random.default_rng(1)
HALF = np.where(RANDOM.random((12, 12)) < 0.3, RANDOM.normal(size=(12, 12)), 0.0)
K = HALF + HALF.T + 5.0 * np.eye(12)
LOWER = np.tril(K)
LABELS = [(node, dof) for node in (-1, 1, 7, 12) for dof in (1, 2, 3)]


def section(values, form, count):
    words = [format(value, form).replace("e", "D") for value in values.tolist()]
    return ["".join(words[i : i + count]) for i in range(0, len(words), count)]


def harwell_boeing(k, width=24, kind="RSA"):
    """As Ansys' HBMAT writes it: exponents with D, a right-hand side; fields touch where they are 23 wide."""
    k = sparse.csc_array(k)
    parts = [
        section(k.indptr + 1, "6d", 13),
        section(k.indices + 1, "6d", 13),
        section(k.data, f"{width}.16e", 3),
        ["1"],
    ]
    counts = [sum(map(len, parts)), *map(len, parts)]
    lines = ["Stiffness", "".join(f"{count:14d}" for count in counts)]
    lines += [f"{kind:14}" + "".join(f"{n:14d}" for n in (*k.shape, k.nnz, 0))]
    lines += [f"{'(13I6)':16}{'(13I6)':16}{f'(1P,3D{width}.16)':20}(1D24.16)", f"{'F':14}{1:14d}{0:14d}"]
    return "\n".join([*lines, *parts[0], *parts[1], *parts[2], *parts[3]])


def coordinate(k):
    return "\n".join(f"{i + 1} {j + 1}  {k[i, j]:.17g}" for i, j in np.argwhere(k))


def fortran(k):
    return "\n".join(f"{i + 1} {j + 1}  {k[i, j]:.17E}".replace("E", "D") for i, j in np.argwhere(k))


def matrix_input(k):
    name = [f"{node},{dof}" for node, dof in LABELS]
    lines = [f"{name[i]}, {name[j]}, {k[i, j]:.17g}" for i, j in np.argwhere(k)]
    return "\n".join(["*MATRIX INPUT, NAME=K", *lines])


def market(k, symmetry="general"):
    return lambda file: scipy.io.mmwrite(file, k, symmetry=symmetry, precision=17)


FILES = {
    "k.mat": lambda file: scipy.io.savemat(file, {"K": sparse.csc_array(K)}),
    "dense.mat": lambda file: scipy.io.savemat(file, {"K": K}),
    "k.npz": lambda file: sparse.save_npz(file, sparse.csr_array(K)),
    "dense.npz": lambda file: np.savez(file, K=K),
    "general.mtx": market(sparse.coo_array(K)),
    "symmetric.mtx": market(sparse.coo_array(K), "symmetric"),
    "both.mtx": coordinate(K),
    "lower.mtx": coordinate(LOWER),
    "both.inp": matrix_input(K),
    "upper.inp": matrix_input(LOWER.T),
    "rua.hb": lambda file: scipy.io.hb_write(file, sparse.csc_array(K)),
    "rsa.matrix": harwell_boeing(LOWER),
    "touching.rsa": harwell_boeing(LOWER, 23),
    # One triangle, where it is all that is meant.
    "lower.mat": lambda file: scipy.io.savemat(file, {"K": LOWER}),
    "lower.npz": lambda file: np.savez(file, K=LOWER),
    "lower.hb": harwell_boeing(LOWER, kind="RUA"),
}
SIZE = f"12 12 {np.count_nonzero(LOWER)}\n"
SYMMETRIC = "MatrixMarket matrix coordinate real symmetric\n"
# Matrix Market as others write it, from other banners and none; exponents of Fortran.
FILES |= {
    "small.mtx": "%%matrixmarket MATRIX Coordinate Real Symmetric\n" + SIZE + coordinate(LOWER),
    "percent.mtx": "%" + SYMMETRIC + "% a comment\n\n" + SIZE + coordinate(LOWER),
    "blank.mtx": "\n  \ufeff%%  " + SYMMETRIC.replace(" ", "   ") + SIZE + coordinate(LOWER),
    "bare.mtx": "% no banner\n" + SIZE + coordinate(LOWER),
    "whole.mtx": f"12 12 {np.count_nonzero(K)}\n" + coordinate(K),
    "fortran.mtx": fortran(LOWER),
    "fortran.txt": "%%" + SYMMETRIC + SIZE + fortran(LOWER),
    "fortran.inp": matrix_input(LOWER.T).replace("e-", "D-"),
    "lower-d.mtx": fortran(LOWER).lower(),
    "gaps.mtx": "%%" + SYMMETRIC + "\n%\n" + SIZE + "\n% late\n" + coordinate(LOWER).replace("\n", "\n\n"),
    "array.mtx": market(K),
}
OTHERS = {
    "job.dof": "".join(f"{1 + i // 3}.{1 + i % 3}\n" for i in range(12)),
    "dashpot.inp": "7,2, 7,2, 3.0",
    "vector.txt": "\n".join(map(str, range(12))),
    "short.txt": "1\n2\n",
    "K.mapping": "Eqn Node DOF\n" + "".join(f"{i} {i // 3} {('UX', 'UY', 'ROTZ')[i % 3]}\n" for i in range(12)),
    "modes.csv": "frequency [Hz],normal,tangential,load\n0,1,0,1\n100,0.5,-2,0.5\n",
    "text.csv": "frequency,normal,tangential\n0,1,two\n",
}
DAMAGED = {
    "two.npz": (lambda file: np.savez(file, K=K, M=K), "key .* K, M"),
    "pickled.npz": (lambda file: np.savez(file, K=np.array([{}], dtype=object)), "allow_pickle"),
    "v73.mat": ("MATLAB 7.3 MAT-file".ljust(124) + "\0\2IM" + "\0" * 400, "'-v7'"),
    "cut.mat": ("MATLAB 5.0 MAT-file".ljust(124) + "\0\1IM" + "\1", "cannot be read"),
    "complex.mtx": (market(sparse.coo_array(1j * K)), "real"),
    "csa.hb": (harwell_boeing(LOWER, kind="CSA"), "CSA, .* RSA"),
    "cut.hb": (harwell_boeing(LOWER)[:900], "cannot be read"),
    "four.mtx": ("1 1 1 1\n", "i, j, value"),
    # SciPy takes the first for 2.0, and ends Python with the second.
    "letter.mtx": ("%%" + SYMMETRIC + "3 3 2\n1 1 2.0Q6\n2 2 1.0\n", "2.0Q6"),
    "more.mtx": ("%%" + SYMMETRIC + "3 3 2\n1 1 2.0 abc\n2 2 1.0 7\n", "abc"),
    "wide.mtx": ("%%" + SYMMETRIC + "3 3 2\n1 1 2.0 7\n2 2 1.0 7\n", "4 numbers; .* must have 3"),
    # A size line that does not agree with its entries, or may be one itself; indices from 0; whole matrices.
    "short.mtx": ("3 3 6\n1 1 2.0\n2 2 2.0\n3 3 1.0\n", "first line, 3 3 6, .* 6 entries, but 3 follow"),
    "lost.mtx": ("3 3 3\n1 1 2.0\n2 2 2.0\n", "first line, 3 3 3, .* but 2 follow"),
    "doubt.mtx": ("3 3 2\n1 1 2.0\n2 2 2.0\n", "first line, 3 3 2, .* or an entry"),
    "oblong.mtx": ("3 4 2\n1 1 2.0\n2 2 2.0\n", "first line, 3 4 2"),
    "zero.mtx": ("0 0 2.0\n0 1 -1.0\n1 1 2.0\n", "count rows and columns from 1"),
    "dense.mtx": ("2e6 -1e6 0\n-1e6 2e6 -1e6\n0 -1e6 1e6\n", "a whole matrix must be"),
    "ones.mtx": ("2 1 1\n1 2 1\n1 1 2\n", "a whole matrix must be"),
    "five.mtx": ("2 -1 0 0 0\n-1 2 -1 0 0\n0 -1 2 -1 0\n0 0 -1 2 -1\n0 0 0 -1 1\n", "a whole matrix must be"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    for name, content in (FILES | OTHERS | {name: content for name, (content, _) in DAMAGED.items()}).items():
        content(folder / name) if callable(content) else (folder / name).write_text(content)
    return folder


@pytest.mark.parametrize("name", FILES)
def test_a_matrix_is_read_as_it_was_written(folder, name):
    read, labels = read_matrix(folder / name)
    whole = LOWER if name in ("lower.mat", "lower.npz", "lower.hb") else K
    assert isinstance(read, sparse.csr_array)
    assert np.array_equal(read.toarray(), whole)
    assert (None if labels is None else [*map(tuple, labels.tolist())]) == (LABELS if "inp" in name else None)


@shared
def test_abaqus_coordinates_of_a_block():
    mass, stiffness = (read_matrix(READERS / f"abaqus_coordinate_{name}.mtx")[0] for name in ("MASS", "STIF"))
    along = np.tile([1.0, 0.0, 0.0], 257)
    assert along @ mass @ along == pytest.approx(11600.0)
    squares = linalg.eigvalsh(stiffness.toarray(), mass.toarray(), subset_by_index=[0, 8])
    assert np.abs(squares[:6]).max() < 1e-6 * squares[6]
    assert np.sqrt(squares[6:]) / (2.0 * np.pi) == pytest.approx([451.3333, 452.0099, 607.8702], rel=1e-6)


@shared
def test_abaqus_matrix_input_of_a_beam():
    """A free beam of 3 m, 0.25 m2 and 100 kg/m3 with two internal degrees of freedom."""
    (mass, labels), (stiffness, _) = (
        read_matrix(READERS / f"abaqus_matrix_input_{n}.mtx") for n in ("MASS", "STIF")
    )
    assert (mass != mass.T).nnz == (stiffness != stiffness.T).nnz == 0
    assert labels[:3].tolist() == [[-1, 1], [-1, 2], [1, 1]]
    across = (labels[:, 0] > 0) & (labels[:, 1] == 2)
    assert across @ mass @ across == pytest.approx(75.0)
    assert np.abs(stiffness @ across).max() < 1e-9


@shared
def test_modes_of_a_universal_file(folder):
    pytest.importorskip("pyuff")
    text = (READERS / "modes_uff55.uff").read_text()
    rows = {"normal": "node 2, y", "load": {"node 1, x": 2, "node 3, z": -1}}
    modes = read_modes(READERS / "modes_uff55.uff", rows)
    expected = {"frequency": [97.013], "normal": [1.8285e-2], "load": [2 * 5.3569e-2 - 4.6623e-3]}
    assert modes == {name: pytest.approx(value) for name, value in expected.items()}
    # A modal mass of 4 kg halves the shape.
    (folder / "heavy.unv").write_text(text.replace("9.7013e+01   0.0", "9.7013e+01   4.0"))
    assert read_modes(folder / "heavy.unv", rows)["normal"] == pytest.approx(modes["normal"] / 2.0)


UNITS = "    -1\n   164\n         5{:<20}         2\n" + "{:25.17E}{:25.17E}{:25.17E}\n{:25.17E}\n    -1\n"


def set_2414(mode, hertz, mass, ratio, shapes, kind):
    """As NX writes it: node numbers and values, of kind 2 real, of kind 5 complex."""
    lines = ["    -1", "  2414", f"{mode:10d}", "Mode", "         1", *["NONE"] * 5]
    lines += ["".join(f"{each:10d}" for each in (1, 2, 2, 8, kind, shapes.shape[1]))]
    lines += ["".join(f"{each:10d}" for each in (0, 0, 1, 0, 0, mode, 0, 0)), "         0         0"]
    lines += ["".join(f"{each:13.5E}" for each in (0, hertz, 0, mass, ratio, 0)), f"{0:13.5E}" * 6]
    for node, row in enumerate(shapes, 7):
        values = row if kind == 2 else np.stack([row, 0.0 * row], axis=1).ravel()
        lines += [f"{node:10d}", "".join(f"{each:13.5E}" for each in values)]
    return "\n".join([*lines, "    -1\n"])


@pytest.mark.parametrize("kind", [2, 5])
@pytest.mark.parametrize(
    ("length", "force"), [(None, None), (1.0, 1.0), (1e3, 1e3), (1e3, 1.0), (3.28084, 0.224809)]
)
def test_universal_files_of_today_are_brought_to_si(folder, kind, length, force):
    """Modes of data set 2414; in mm and mN masses are kg, in mm and N tonnes, in feet and pounds slugs."""
    pytest.importorskip("pyuff")
    shapes = RANDOM.normal(size=(2, 4, 6 if kind == 2 else 3))
    scale, turn = (1.0, 1.0) if length is None else (np.sqrt(length / force), length)
    units = "" if length is None else UNITS.format("made up", length, force, 1.0, 273.15)
    # Translations for a unit of kg^1/2 m, rotations by that of a metre less.
    written = shapes * scale * (np.array([1.0] * 3 + [1.0 / turn] * 3)[: shapes.shape[2]])
    text = (
        units + set_2414(1, 100.0, 1.0, 0.01, written[0], kind) + set_2414(2, 250.0, 4.0, 0.02, written[1], kind)
    )
    (folder / "today.unv").write_text(text)
    last = "rx" if kind == 2 else "z"
    modes = read_modes(folder / "today.unv", {"normal": "node 8, y", "tangential": f"node 10, {last}"})
    column = 3 if kind == 2 else 2
    expected = {"frequency": [100.0, 250.0], "damping_ratio": [0.01, 0.02], "normal": shapes[:, 1, 1]}
    expected |= {"tangential": shapes[:, 3, column]}
    for name in ("normal", "tangential"):
        expected[name] = expected[name] / [1.0, 2.0]
    assert modes == {name: pytest.approx(value, rel=1e-5) for name, value in expected.items()}
    if units:
        (folder / "today.unv").write_text(text + UNITS.format("other", 2.0, 1.0, 1.0, 0.0))
        with pytest.raises(InputError, match=r"units \(data set 164\) differ"):
            read_modes(folder / "today.unv", {"normal": "node 8, y"})
    if kind == 5:
        complex_text = text.replace(f"{0:13.5E}\n", f"{1:13.5E}\n")
        (folder / "today.unv").write_text(complex_text)
        with pytest.raises(InputError, match="real normal modes"):
            read_modes(folder / "today.unv", {"normal": "node 8, y"})


def arguments(folder, text):
    (folder / "pin.toml").write_text(text)
    return structure_arguments(folder / "pin.toml")


def model(file, rest, tangential="node 2, x"):
    return f"mass = '{file}'\nstiffness = {{file = '{file}'}}\ntangential = '{tangential}'\nload = 0\n{rest}\n"


def test_a_model_of_matrices(folder):
    text = 'normal = {"node 2, y" = 1.0, 11 = -0.5}\noutput = "vector.txt"\ndofs_per_node = 3\nd1 = 50\nfmax = 1e4'
    constructor, given = arguments(folder, model("both.mtx", text))
    assert constructor == "from_matrices"
    assert all(np.array_equal(given.pop(name).toarray(), K) for name in ("mass", "stiffness"))
    assert given.pop("names") == [f"node {node}, {way}" for node in (1, 2, 3, 4) for way in "xyz"]
    assert given.pop("output") == {i: float(i) for i in range(12)}
    assert given == {"normal": {4: 1, 11: -0.5}, "tangential": {3: 1}, "load": {0: 1}, "d1": 50, "fmax": 1e4}
    mapped = arguments(folder, model("rsa.matrix", 'nodes = "K.mapping"\nnormal = 2', "node 3, rz"))[1]
    assert (mapped["tangential"], mapped["normal"]) == ({11: 1}, {2: 1})
    calculix = arguments(folder, model("both.mtx", 'nodes = "job.dof"\nnormal = "node 4, z"', "node 2, y"))[1]
    assert (calculix["tangential"], calculix["normal"], calculix["names"][4]) == ({4: 1}, {11: 1}, "node 2, y")


def test_matrices_of_several_nodes_are_brought_together(folder):
    given = arguments(folder, model("upper.inp", 'damping = "dashpot.inp"\nnormal = "node 7, y"', "node -1, z"))[1]
    assert np.array_equal(given["mass"].toarray(), K)
    assert np.argwhere(given["damping"].toarray()).tolist() == [[7, 7]]
    assert (given["normal"], given["tangential"]) == ({7: 1}, {2: 1})


MODE = "[[mode]]\nfrequency = {}\nnormal = {}\ntangential = {}\nload = {}\n"


@pytest.mark.parametrize("text", ['modes = "modes.csv"', MODE.format(0, 1, 0, 1) + MODE.format(100, 0.5, -2, 0.5)])
def test_tables_of_modes(folder, text):
    constructor, given = arguments(folder, "d2 = 1e-8\n" + text)
    expected = {"frequency": [0, 100], "normal": [1, 0.5], "tangential": [0, -2], "load": [1, 0.5], "d2": 1e-8}
    assert constructor == "from_modes"
    assert {name: np.asarray(value).tolist() for name, value in given.items()} == expected


THREE = "dofs_per_node = 3\n"
WRONG = [
    ("", "mass: it is missing"),
    ("mass = ", "pin.toml: it cannot be read"),
    (model("both.mtx", 'norml = "node 2, y"'), "norml: .* normal"),
    (model("bath.mtx", "normal = 1"), "mass: bath.mtx: .* both.mtx"),
    (model("both.mtx", THREE + 'normal = "node 22, y"'), "normal = 'node 22, y': .* node 2, y"),
    (model("both.mtx", THREE + "normal = 12"), "normal = 12: .* from 0 to 11"),
    (model("both.mtx", THREE + "normal = true"), "normal = True: .* from 0 to 11"),
    (model("both.mtx", THREE + 'normal = "short.txt"'), "normal = 'short.txt': .* 2 .* 12"),
    (model("both.mtx", THREE + 'normal = {1 = "a"}'), "normal = .* weight = 'a'"),
    (model("both.mtx", THREE + 'normal = 1\nd1 = "fifty"'), "d1 = 'fifty'"),
    (model("both.mtx", "dofs_per_node = 5\nnormal = 1"), "10.* dofs_per_node"),
    (model("both.mtx", "normal = 1"), "tangential = 'node 2, x': .* dofs_per_node"),
    ('modes = "modes.csv"\nnormal = 1', "modes.csv: normal .* column"),
    ('modes = "text.csv"', "text.csv: .* 'two'"),
    ("[[mode]]\nfrequency = 3\nnormal = 1\n", "tangential: it is missing"),
    *((model(name, "normal = 1"), f"mass: .*{name}: .*{message}") for name, (_, message) in DAMAGED.items()),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_what_is_wrong_is_said_in_one_line(folder, text, message):
    with pytest.raises(InputError, match=message) as caught:
        arguments(folder, text)
    assert str(caught.value).startswith(f"{folder / 'pin.toml'}: ")
    assert "\n" not in str(caught.value)
