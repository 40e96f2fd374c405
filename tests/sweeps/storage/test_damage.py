"""Damage by a disk: it is noticed, costs what was damaged and no more, and never changes a value unseen."""

import random

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sweeps import InputError, StoreError, Variable, open_results, status
from sweeps.errors import UNREADABLE
from sweeps.storage import existing, netcdf
from sweeps.storage.netcdf import CHECKSUM
from sweeps.storage.parts import SMALL, BatchResult, Failure, Manifest, Packed, PartWriter, pack
from sweeps.storage.store import Store
from tests.helpers.waves import GRID, LOG, NAMES, interrupted, sweep

GROWN = GRID | {"x": np.arange(1.0, 7.0)}
MISMATCH = "sweep.nc is damaged: its checksum does not match; move it away"

pytestmark = pytest.mark.usefixtures("small_pieces")


@pytest.fixture
def half(path):
    """The store of a run that was interrupted when four of its six points were done."""
    interrupted(sweep().plan(path), 4)
    return Store(path)


@pytest.fixture
def whole(path):
    """A finished file."""
    sweep().plan(path).run("sync")
    return path


def flip(path, bit):
    """Change one bit of a file."""
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


def flip_in(path, what):
    """Change a bit of some bytes of a file."""
    flip(path, 8 * path.read_bytes().rindex(what))


def flips(path, count, begin=0):
    """Change a bit of a file, again and again: of a small file one of each byte."""
    good = path.read_bytes()
    bits = [8 * byte + byte % 8 for byte in range(begin, len(good))]
    for bit in bits if len(bits) <= count else random.Random(1).sample(bits, count):  # noqa: S311 - reproducible
        flip(path, bit)
        yield bit
        path.write_bytes(good)


def content(packed):
    """Everything that an archive contains."""
    arrays = [(each.dtype.str, each.shape, each.tobytes()) for each in map(packed.read, packed.names)]
    return packed.header, packed.names, arrays


@pytest.mark.parametrize(("rows", "count"), [(2, 1_000), (10_000, 200)])
def test_a_flipped_bit_of_a_part_is_noticed_or_changes_nothing(tmp_path, rows, count):
    writer = PartWriter(tmp_path, {"y": Variable(digits=4)}, "token")
    result = BatchResult({"y": np.linspace(0.0, 1.0, rows)}, np.ones(rows), {1: Failure("no", "here", "again")})
    result.points = np.r_[np.arange(rows - 1), rows]
    writer.write(name := writer.next_name(), result)
    part = tmp_path / name
    assert (part.stat().st_size > SMALL) == (rows > 2)
    good, noticed = content(Packed(part)), []
    for _ in flips(part, count):
        try:
            noticed.append(content(Packed(part)) != good)
            assert not noticed[-1]
        except UNREADABLE:
            noticed.append(True)
    assert np.mean(noticed) > 0.7  # the others are of dates and permissions


DAMAGES = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "emptied": lambda path: path.write_bytes(b""),
    "a flipped bit": lambda path: flip(path, 8 * 60),
    "deleted": lambda path: path.unlink(),
}


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_part_is_reported_and_its_points_alone_are_computed_again(half, how):
    name, expected = half.part_names()[0], sweep().plan().run("sync")
    count = Packed(half.parts / name).header["rows"]
    DAMAGES[how](half.parts / name)
    plan, seen = sweep().plan(half.file), how != "deleted"
    assert plan.damaged == (name,) * seen
    assert (f"damaged         {name}: its points are computed again" in repr(plan)) == seen
    assert np.count_nonzero(open_results(half.file)["status"] == 1) == status(half.file).done == 4 - count
    LOG.clear()
    xr.testing.assert_equal(plan.run("sync")[NAMES], expected[NAMES])
    assert len(LOG) == 2 + count


def test_a_flipped_bit_of_the_manifest_costs_nothing(half):
    for _ in flips(half.manifest, 150):
        manifest = Manifest.load(half)
        assert (manifest.name, manifest.grid.shape) == ("waves", (3, 2))
    flip(half.manifest, 8 * 60)
    LOG.clear()
    assert np.all(sweep().plan(half.file).run()["status"] == 1)
    assert len(LOG) == 2


def other_version(path):
    """A manifest whose variables have one field more."""
    file = Packed(path)
    assert "digits" in file.header["format"]  # every field is
    header = file.header | {"format": [*file.header["format"], "colour"]}
    header["variables"]["root"]["colour"] = "red"
    pack(path, header, {name: file.read(name) for name in file.names})


def attempts(path):
    """Everything that reads a store."""
    return (lambda: sweep().plan(path).run(), lambda: open_results(path), lambda: status(path))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda path: flip(path, 8 * 60), "manifest and its copy are damaged, .*or start over"),
        (other_version, "is of another version of sweeps; finish the run with that version, or"),
    ],
)
def test_without_a_usable_manifest_a_run_is_refused_and_deletes_nothing(half, change, told):
    change(half.manifest)
    change(half.manifest.with_suffix(".copy"))
    before = {each: each.stat() for each in half.parts.iterdir()}
    for attempt in attempts(half.file):
        with pytest.raises((StoreError, InputError), match=f"^{half.parts}.*{told}[^\n]*$"):
            attempt()
    assert {each: each.stat() for each in half.parts.iterdir()} == before
    assert np.all(sweep().plan(half.file, fresh=True).run()["status"] == 1)


@pytest.mark.parametrize(("count", "last"), [(150, 0), (40, len(CHECKSUM) + 8)])
def test_any_flipped_bit_of_a_finished_file_is_noticed(whole, count, last):
    for bit in flips(whole, count, begin=(whole.stat().st_size - last) * (last > 0)):
        # A name of its own: netCDF may keep what could not be closed.
        other = whole.rename(whole.with_name(f"{bit}.nc"))
        for attempt in attempts(other):
            with pytest.raises((InputError, StoreError), match="damaged"):
                attempt()
        other.rename(whole)


HARMS = [lambda a: a[: len(a) // 2], lambda a: a[:10], lambda a: b"", lambda a: b"no" * 100, lambda a: CHECKSUM]


@pytest.mark.parametrize("harm", HARMS)
def test_a_file_that_is_cut_or_overwritten_is_refused_and_stays(whole, harm):
    whole.write_bytes(bad := harm(whole.read_bytes()))
    for attempt in (*attempts(whole), lambda: sweep(GROWN).plan(whole)):
        with pytest.raises((InputError, StoreError), match=r"sweep.nc.* damaged"):
            attempt()
    assert whole.read_bytes() == bad


def test_a_large_file_is_checked_where_it_is_read_and_as_a_whole_when_it_grows(path, limits, monkeypatch):
    limits(400)
    monkeypatch.setattr(netcdf, "CHECKED", 1000)
    monkeypatch.setattr(existing, "CHECKED", 1000)
    sweep(GRID | {"x": np.arange(30.0)}).plan(path).run("sync").close()
    with netCDF4.Dataset(path) as file:
        assert all(each.filters()["fletcher32"] for each in file.variables.values() if each.dtype != "S1")
    flip_in(path, np.sqrt([2.0, 4.0]).tobytes())
    with open_results(path) as data, pytest.raises(RuntimeError, match="HDF error"):
        data["root"].load()
    with pytest.raises(StoreError, match=MISMATCH):
        sweep(GRID | {"x": np.arange(31.0)}).plan(path).run("sync")
