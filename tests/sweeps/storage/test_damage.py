"""Damage by a disk: it is noticed, costs what was damaged and no more, and never changes a value unseen."""

import errno
import random
import zlib
from contextlib import nullcontext, suppress

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sweeps import InputError, StoreError, Variable, open_results, status
from sweeps.errors import UNREADABLE
from sweeps.storage import parts, store
from sweeps.storage.assemble import Table, present
from sweeps.storage.existing import sources_of
from sweeps.storage.parts import SMALL, BatchResult, Failure, Manifest, Packed, PartWriter, pack
from sweeps.storage.store import TRAILER, Store, signature
from tests.helpers.waves import GRID, LOG, NAMES, interrupted, sweep

GROWN = GRID | {"x": np.arange(1.0, 7.0)}

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


@pytest.mark.parametrize(("rows", "count"), [(2, 500), (10_000, 30)])
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
    assert np.mean(noticed) > 0.6  # the others are of dates and permissions


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


def test_parts_that_are_or_turn_out_to_be_damaged_are_left_out(half):
    first, second, *others = half.part_names()
    flip(half.parts / first, 8 * 60)
    table = Table(manifest := Manifest.load(half), sources_of(half, manifest))
    assert table.damaged == [first]
    assert [each.name for each in table.without(second)] == others


@pytest.mark.parametrize(
    ("dtype", "attributes", "noticed"),
    [
        ("f8", {}, True),
        ("i4", {}, True),
        ("i1", {"flag_values": [0, 1]}, True),
        ("f4", {"_FillValue": 0.0}, False),
        ("i1", {}, False),
        ("U3", {}, False),
    ],
)
def test_what_netcdf_fills_in_for_lost_values_is_noticed_where_no_result_can_be_that(dtype, attributes, noticed):
    values = np.array([netCDF4.default_fillvals.get(dtype, "x"), 1]).astype(dtype)
    lost, good = (xr.Variable("x", each, attributes) for each in (values, values[1:]))
    assert present(good).tolist() == good.values.tolist()
    with pytest.raises(OSError, match="values are lost") if noticed else nullcontext():
        present(lost)


def test_a_flipped_bit_of_the_manifest_costs_nothing(half):
    for _ in flips(half.manifest, 30):
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
    before = {each: signature(each) for each in half.parts.iterdir()}
    for attempt in attempts(half.file):
        with pytest.raises((StoreError, InputError), match=f"^{half.parts}.*{told}[^\n]*$"):
            attempt()
    assert {each: signature(each) for each in half.parts.iterdir()} == before
    assert np.all(sweep().plan(half.file, fresh=True).run()["status"] == 1)


def test_a_manifest_that_cannot_be_read_is_not_called_damaged(half, monkeypatch):
    def closed(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(parts, "check_regular", closed)
    with pytest.raises(StoreError, match=r"manifest cannot be read: .*ermission"):
        Manifest.load(half)
    half.manifest.unlink()
    assert Manifest.load(half) is None


def test_a_folder_of_parts_that_cannot_be_read_is_not_called_empty(half, monkeypatch):
    def closed(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(store.os, "scandir", closed)
    with pytest.raises(StoreError, match=r"parts cannot be read: .*ermission"):
        half.part_names()


def test_a_result_is_there_as_a_file_or_as_parts(path):
    assert not Store(path).exists()
    interrupted(sweep().plan(path), 4)
    assert Store(path).exists()
    sweep().plan(path).run("sync")
    assert Store(path).exists()


def numbers(content, values):
    """Where the bytes of numbers lie in a file: of some values as they are, and of all that are compressed."""
    places = [slice(begin := content.index(raw), begin + len(raw)) for raw in (each.tobytes() for each in values)]
    begin = content.find(b"\x78\x5e")
    while begin >= 0:
        stream = zlib.decompressobj()
        try:
            stream.decompress(content[begin:])
            end = len(content) - len(stream.unused_data)
        except zlib.error:
            end = begin + 1
        places += [slice(begin, end)] * (stream.eof and end > begin + 8)
        begin = content.find(b"\x78\x5e", end)
    return places


def test_any_flipped_bit_of_a_finished_files_numbers_is_noticed_where_they_are_read(whole):
    """Those of axes are stored as they are, others compressed."""
    good, first, right = whole.read_bytes(), open_results(whole), sweep(GROWN).plan().run("sync")
    places = numbers(good, [np.array(GRID["x"]), np.array(GRID["y"])])
    assert len(places) > 2 + len(NAMES)
    chance = random.Random(1)  # noqa: S311 - reproducible
    bits = [8 * byte + chance.randrange(8) for each in places for byte in range(each.start, each.stop)]
    for bit in chance.sample(bits, 25):
        # A name of its own: netCDF may keep what could not be closed.
        flip(other := whole.rename(whole.with_name(f"{bit}.nc")), bit)
        with suppress(InputError):  # the last byte of what is compressed has bits in no use
            xr.testing.assert_identical(open_results(other), first)
        # A run reads no texts of points that did not fail.
        with suppress(StoreError):
            xr.testing.assert_equal(sweep(GROWN).plan(other).run("sync")[NAMES], right[NAMES])
        other.unlink()
        whole.write_bytes(good)


def test_a_flipped_bit_anywhere_else_is_noticed_or_changes_no_number(whole):
    """But in HDF5's index of chunks: a chunk that it does not find is noticed by what is there in its place."""
    right = open_results(whole)
    for bit in flips(whole, 40):
        other = whole.rename(whole.with_name(f"{bit}.nc"))
        with suppress(InputError):
            for name, each in open_results(other).items():
                assert each.dtype.kind not in "iuf" or np.array_equal(each, right[name], equal_nan=True)
        other.rename(whole)


HARMS = [lambda a: a[: len(a) // 2], lambda a: a[:10], lambda a: b"", lambda a: b"no" * 100, lambda a: TRAILER]


@pytest.mark.parametrize("harm", HARMS)
def test_a_file_that_is_cut_or_overwritten_is_refused_and_stays(whole, harm):
    whole.write_bytes(bad := harm(whole.read_bytes()))
    for attempt in (*attempts(whole), lambda: sweep(GROWN).plan(whole)):
        with pytest.raises((InputError, StoreError), match=r"sweep.nc.* damaged"):
            attempt()
    assert whole.read_bytes() == bad


def test_a_large_file_is_checked_where_it_is_read(path, limits):
    """By the reader of these values, and by a run that takes them over."""
    limits(400)
    sweep(GRID | {"x": np.arange(30.0)}).plan(path).run("sync").close()
    with netCDF4.Dataset(path) as file:
        assert all(each.filters()["fletcher32"] for each in file.variables.values() if each.ndim)
    flip(path, 8 * path.read_bytes().rindex(np.sqrt([2.0, 4.0]).tobytes()))
    with open_results(path) as data, pytest.raises(RuntimeError, match="HDF error"):
        data["root"].load()
    with pytest.raises(StoreError, match=r"sweep.nc is damaged or not netCDF; move it away"):
        sweep(GRID | {"x": np.arange(31.0)}).plan(path).run("sync")


def test_the_status_is_read_alone(whole, monkeypatch):
    """Of a list of many files, nothing else of each."""
    read, original = [], xr.Variable.load
    monkeypatch.setattr(xr.Variable, "load", lambda self, **how: read.append(self.size) or original(self, **how))
    assert status(whole).done == 6
    assert read == [6]
