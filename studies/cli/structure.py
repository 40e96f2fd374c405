"""The command `structure`, which shows a user's structure. Heavy packages are imported inside it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command
from studies.cli.options import MOVING, OUT
from studies.cli.output import columns, say, show

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fivcore import FlutterOnsets, Structure

# Modes in the table. A structure with less mass than a gram at its contact is hardly one that moves below so many
# Hz; below this share of the largest product of its gaps' weights a mode couples them by rounding.
MOST, GRAM, SLOW, COUPLED = 40, 1e-3, 5e3, 1e-9
# Values of friction in the table of sliding modes.
COLUMNS = 6
FILE = click.argument("file", metavar="FILE.toml")
FMAX = click.option("--fmax", default="10kHz", show_default=True, help="Band of onsets and figure.")
MU = click.option("--mu", type=float, default=1.0, show_default=True, help="Largest coefficient of friction.")
LOAD = click.option("--load", default="1N", show_default=True, help="Load under which several contacts are shown.")


AT = click.option("--at", type=float, metavar="MU", help="Friction of the modes; default: at the first onset.")
MODES = click.option("--modes", type=click.Path(), help="Write the open and the sliding modes: FILE.npz or .uff.")
TITLE = "What was read of an own structure, with a figure."


@command("structure", TITLE, FILE, OUT, FMAX, MU, LOAD, AT, MODES, *MOVING)
def structure(
    file: str, out: str | None, fmax: str, mu: float, load: str,
    at: float | None, modes: str | None, film: str | None, vtu: bool,
) -> None:  # fmt: skip
    """Modes, contact, preload, damping and flutter onsets of a structure of one's own, and its receptances.

    \b
    fiv structure pin.toml
    fiv run scenes --rig pin.toml
    fiv structure disc.toml --animate --vtu --modes disc.uff

    The figure, FILE.png in the folder `structure` of the results, has the growth rate over friction too.

    FILE.toml is in SI. It names files of `mass` and `stiffness`, or lists modes. `normal` is the motion that opens
    the contact. `tangential` is the motion of the structure's surface in the sliding direction (with a minus it
    slides the other way). `load` says where the force F acts and in which direction. Optional: `output` (the
    motion that is observed as B; default: the tangential one), `drive` (for a structure whose base is driven over
    a fixed surface: M r, with r the rigid motion of all rows for a unit motion of the base), `damping` (a file),
    `damping_ratio`, `d1`, `d2`, `fmax`. Rows are named "node N, DIRECTION" by `nodes` or `dofs_per_node`, or by
    their number from 0. With several contacts `normal` and `tangential` are lists, or
    `contacts` is one of tables with these and `gap` (m, 0 if not given) and `friction` (factor of mu, 1), or
    pairs of nodes: contacts = {pairs = [[12, 40], [13, 41]], normal = "y", tangential = "x"}.

    With `positions`, a file with node, x, y, z (m), modes are brought back to the nodes: --animate and --vtu show
    the sliding mode that grows fastest, --modes writes all below --fmax.

    From Nastran, with pyNastran in another environment, for it needs an older NumPy; the punch file (EXTRN) lists
    node and direction of the rows, for rows.txt:

    \b
    M, K = (csr_array(read_op4("bulk.op4")[name].data) for name in ("MAA", "KAA"))
    kept = M.diagonal() > 0
    mmwrite("M.mtx", M[kept][:, kept])
    mmwrite("K.mtx", K[kept][:, kept])

    From Ansys Mechanical APDL, with ansys-mapdl-reader, also in another environment, which gives the upper
    triangles:

    \b
    rows, K, M = reader.read_binary("model.full").load_km(sort=False)
    free = K.diagonal() > 0
    for name, upper in (("K.mtx", K), ("M.mtx", M)):
        mmwrite(name, (upper + triu(upper, 1).T)[free][:, free])
    np.savetxt("rows.txt", rows[free] + [0, 1], "%d")
    """  # noqa: D301 - the backspace tells click to keep the lines
    from fivcore import checks, flutter_onsets, painleve_mu, sliding_modes
    from studies.answering import mode_files
    from studies.answering.results import expanded, results_folder
    from studies.asking.request import own_structure
    from studies.declaring import spec
    from studies.plotting import figures, moving, receptances
    from studies.runner import animate, atomic_write

    band = checks.band(spec.one(fmax, "fmax", "Hz"))
    mu = checks.between("--mu", mu, 1e-6, 1e3, "a coefficient of friction")
    own: Any = own_structure(file)
    if film or vtu or (modes and not modes.endswith(".npz")):
        own.displacement(0.0 * own.frequency)  # before all else is computed
    force = checks.between("--load", spec.one(load, "load", "N"), 1e-100, 1e100, "N")
    show("\n".join(structure_lines(own)))
    if own.several:
        show("\n".join(contacts(own, force)))
    onsets = None
    try:
        onsets = flutter_onsets(own, 0.0, band, mu, F=force)
        show("\n".join(_onsets(onsets, band, mu)))
        show("\n".join(_sliding(own, band, mu, force)))
    except ArithmeticError as problem:
        show(f"flutter onsets: they could not be computed: {problem}")
    try:
        if (limit := painleve_mu(own, 0.0)) <= mu:
            show(f"the contact force is not unique from mu = {limit:.5g} on (Painlevé's paradox)")
    except ValueError as problem:
        show(f"no motion: {problem}")
    show("\n".join(hints(own)), end="\n" if any(hints(own)) else "")
    target = results_folder(out) / "structure" / f"{Path(file).stem}.png"
    with figures.style(), atomic_write(target) as temporary:
        temporary.write_bytes(figures.saved(receptances.draw(own, band, mu, onsets, force), "png", own.digest))
    paths = [target]
    if modes or film or vtu:
        first = 1.001 * float(onsets.mu[0]) if onsets is not None and len(onsets.mu) else 0.0
        sliding = sliding_modes(own, 0.0, first if at is None else at, band, F=force)
        if modes:
            with atomic_write(path := expanded(modes)) as temporary:
                mode_files.write(temporary, path.suffix.lower(), own, sliding)
            paths.append(path)
        paths += animate([moving.sliding(own, sliding)], target, film, vtu) if film or vtu else []
    say("\nwritten: " + ", ".join(map(str, paths)))


def structure_lines(own: Structure) -> Iterator[str]:
    """Modes, contact rows, preload, rigid motions, and damping with the contact tied, as lines."""
    import numpy as np

    from fivcore import InputError

    yield f"{own!r}\ndigest {own.digest}\n"
    damping = own.damping[: len(own.frequency)]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = damping / (4.0 * np.pi * own.frequency)
    heads = ["mode", "frequency Hz", "normal", "tangential", "load", "output", "damping ratio"]
    parts = [own.frequency, own.normal, own.tangential, own.load, own.output, ratio]
    if own.several:
        del heads[2:4], parts[1:3]
    table = zip(*parts, strict=False)
    rows = [(f"{k}", f"{row[0]:.6g}", *(f"{each:.4g}" for each in row[1:])) for k, row in enumerate(table, 1)]
    yield columns([heads, *rows[:MOST]])
    if len(rows) > MOST:
        yield f"and {len(rows) - MOST} more, up to {own.frequency[-1]:.6g} Hz"
    rigid = int(np.count_nonzero(own.stiffness == 0.0))
    try:
        preload = f"{own.preload:.6g}"
    except InputError:
        preload = "none"
    found: dict[str, Any] = {"preload (normal force at rest for a unit load)": preload}
    for name, row in (("normal", own.normal), ("tangential", own.tangential)) if not own.several else ():
        elastic = own.stiffness > 0.0
        compliance = float(np.sum(row[elastic] ** 2 / own.stiffness[elastic]))
        found[f"{name} effective mass, kg"] = f"{effective_mass(own, row):.6g}"
        found[f"{name} static stiffness of the elastic modes, N/m"] = f"{1.0 / max(compliance, 1e-300):.6g}"
    found["rigid motions"] = rigid
    found["damping"] = "by mode" if own.rayleigh is None else f"d1 = {own.d1:g} 1/s, d2 = {own.d2:g} s"
    found["drive"] = "the base moves" if own.inertia.any() else "a rigid surface slides past"
    yield "\n" + columns([(name, str(value)) for name, value in found.items()])
    both = enumerate(zip(*own.tied_damping, strict=True), 1)
    tied = [(f"{k}", f"{hertz:.6g}", f"{ratio:.4g}") for k, (hertz, ratio) in both]
    yield "\n" + columns([("tied mode", "frequency Hz", "damping ratio"), *tied[:MOST]]) if tied else ""
    yield from (f"remark: {remark}" for remark in own.remarks)
    if own.static:
        yield f"remark: modes above {own.frequency[-1]:.6g} Hz act by their static compliance"


def contacts(own: Structure, load: float) -> Iterator[str]:
    """Force at each contact under a load, N, its gap, and its rows, as lines."""
    forces, gaps = own.equilibrium(load)
    heads = ("contact", "friction", "initial gap m", "force N", "gap m", "normal kg", "tangential kg")
    own_columns = own.friction, own.gap, forces, gaps
    masses = ([effective_mass(own, row) for row in rows] for rows in (own.normal, own.tangential))
    rows = [
        (f"{k}", *(f"{each:.4g}" for each in row)) for k, row in enumerate(zip(*own_columns, *masses, strict=True))
    ]
    yield "\n" + columns([heads, *rows])
    closed = f"{int((forces > 0.0).sum())} of {own.contacts} contacts are closed"
    yield f"{closed} under {load:g} N; they bear {forces.sum():.6g} N"


def effective_mass(own: Structure, row: Any) -> float:
    """Effective mass along a gap, 1 / sum(row^2) over the computed modes, kg."""
    return float(1.0 / max(float((row[: len(own.frequency)] ** 2).sum()), 1e-300))


def _onsets(onsets: FlutterOnsets, fmax: float, mu: float) -> Iterator[str]:
    """Onsets and recoveries, ascending in mu, and the friction at which the contact jams."""
    crossings = [(a, b, "onset") for a, b in zip(onsets.mu, onsets.frequency, strict=True)]
    crossings += [(a, b, "recovery") for a, b in zip(onsets.recovery_mu, onsets.recovery_frequency, strict=True)]
    crossings += [(each, fmax, "a growing pair enters the band") for each in onsets.entry_mu]
    rows = [(f"{a:.5g}", f"{b:.6g}", text) for a, b, text in sorted(crossings)]
    yield f"\n{'flutter' if rows else 'no flutter onset'} up to mu = {mu:g}, below {fmax:g} Hz"
    yield columns([("mu", "Hz", ""), *rows]) if rows else ""
    if onsets.divergence_mu <= mu:
        yield f"jams: growth without oscillation from mu = {onsets.divergence_mu:.5g} on"


def _sliding(own: Structure, fmax: float, mu: float, load: float) -> Iterator[str]:
    """Frequencies and growth rates of the modes along friction, by their numbers."""
    import numpy as np

    from fivcore import InputError, followed_modes

    found = list[Any]()
    for friction in np.linspace(0.0, mu, COLUMNS).tolist():
        with suppress(InputError):
            modes = followed_modes(own, 0.0, [friction], fmax, F=load)
            rates = zip(modes.frequency[0].tolist(), modes.growth_rate[0].tolist(), strict=True)
            cells = ["" if f != f else f"{f:.5g}" + (f" ({r:+.3g})" if r > 0.0 else "") for f, r in rates]
            found.append([f"mu = {friction:.3g}", *cells])
    most = max(map(len, found), default=1)
    table = [column + [""] * (most - len(column)) for column in ([["", *map(str, range(1, most))], *found])]
    rows = [row for row in zip(*table, strict=True) if any(row[1:])]
    yield "\nmodes of steady sliding, Hz, with the growth rate, 1/s, where they grow"
    yield columns([("mode", *rows[0][1:]), *rows[1 : MOST + 1]]) if rows else ""


def hints(own: Structure) -> Iterator[str]:
    """Hints at units of mm, t and s, and at rows that do not couple."""
    import numpy as np

    elastic, most = own.frequency[own.frequency > 0.0], len(own.frequency)
    rows = [np.atleast_2d(row) for row in (own.normal, own.tangential)]
    mass = min(effective_mass(own, row) for each in rows for row in each)
    if mass < GRAM and len(elastic) and elastic[0] < SLOW:
        yield (
            f"hint: the contact moves only {mass:.3g} kg, though the lowest elastic mode has {elastic[0]:.4g} Hz: "
            "if the model is in mm, t, s, multiply mass and stiffness by 1000"
        )
    normal, tangential = (np.abs(each[:, :most]) for each in rows)
    if (normal * tangential).max() <= COUPLED * normal.max() * tangential.max():
        yield "hint: no mode moves both gaps, so that friction cannot cause flutter; check normal and tangential"
