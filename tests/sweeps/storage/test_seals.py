"""Whatever has changed in a file without its being written is noticed, or changes nothing that is read."""

import random

import netCDF4
import numpy as np
import pytest

from sweeps import InputError, StoreError, open_results
from sweeps.storage import checked
from tests.helpers.waves import GRID, sweep

FLIPS = 150
X = np.array(GRID["x"]).tobytes()


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "waves.nc"
    sweep().plan(path).run("sync")
    return path


def flip(path, place):
    content = bytearray(path.read_bytes())
    content[place // 8] ^= 1 << place % 8
    path.write_bytes(content)


def flip_in(path, what):
    """Change the last bit of some bytes in a file."""
    flip(path, 8 * (path.read_bytes().rindex(what) + len(what) - 1))


def unseal(path):
    """Whoever changes a file by HDF5 takes its seal off."""
    with netCDF4.Dataset(path, "a") as file:
        file.title = "Another"
    assert checked.SEAL not in path.read_bytes()


@pytest.mark.parametrize("what", [X, np.array([1, 2, 3]).tobytes(), b"long_name", b"waves computed by"])
def test_coordinates_and_attributes_are_checked(path, what):
    flip_in(path, what)
    with pytest.raises(InputError, match=f"^{path}: it is damaged: its content is not what was written$"):
        open_results(path)
    with pytest.raises(StoreError, match=f"^{path} is damaged: its content is not what was written; move it away"):
        sweep().plan(path)


def unnoticed(path, places):
    """Those places of bits that change what is read."""
    whole, expected, found = path.read_bytes(), open_results(path), []
    for number, place in enumerate(places):
        # A name of its own: netCDF may keep what could not be closed.
        other = path.with_name(f"{number}.nc")
        other.write_bytes(whole)
        flip(other, place)
        try:
            if not open_results(other).identical(expected):
                found.append(place)
        except InputError:
            pass
        other.unlink()
    return found


def drawn(path, count):
    bits = 8 * path.stat().st_size
    return [random.Random(seed).randrange(bits) for seed in range(count)]  # noqa: S311 - nobody is to be surprised


def test_no_bit_changes_a_value_unseen(path):
    assert unnoticed(path, drawn(path, FLIPS)) == []


@pytest.mark.slow
def test_none_of_many_bits_changes_a_value_unseen(path):
    assert unnoticed(path, drawn(path, 20 * FLIPS)) == []


def test_nor_does_one_of_the_seal_itself(path):
    bits = 8 * path.stat().st_size
    assert unnoticed(path, range(bits - 8 * len(checked.SEAL) - 64, bits)) == []


@pytest.mark.parametrize("harm", [lambda whole: whole[:-500] + bytes(500), lambda whole: whole + b"more"])
def test_what_stands_in_the_place_of_a_seal_is_noticed(path, harm):
    """A block of a disk is lost as a whole."""
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(InputError, match=r"damaged: its content is not what was written$"):
        open_results(path)
    with pytest.raises(StoreError, match="its content is not what was written; move it away"):
        sweep().plan(path)


def test_files_without_a_seal_are_read_and_completed(path):
    unseal(path)
    assert open_results(path).attrs["title"] == "Another"
    # Nothing else notices this.
    flip_in(path, X)
    assert not np.array_equal(open_results(path)["x"], GRID["x"])
    flip(path, 8 * path.read_bytes().rindex(X[:-1]) + 8 * len(X) - 8)
    assert sweep(GRID | {"x": [1.0, 2.0, 3.0, 4.0]}).plan(path).run("sync").sizes["x"] == 4
    flip_in(path, np.array([1.0, 2.0, 3.0, 4.0]).tobytes())
    with pytest.raises(InputError, match="its content is not what was written"):
        open_results(path)


def test_heaps_in_which_hdf5_would_stay_for_ever_are_refused(path):
    """Its library goes from object to object by their lengths: free space that has none has no end."""
    unseal(path)
    whole = path.read_bytes()
    at = whole.index(checked.HEAP) + 16
    path.write_bytes(whole[:at] + bytes(16) + whole[at + 16 :])
    with pytest.raises(InputError, match=f"^{path}: it is damaged: a heap of it has no end$"):
        open_results(path)
    with pytest.raises(StoreError, match=f"^{path} is damaged: a heap of it has no end; move it away"):
        sweep().plan(path)


def test_a_large_file_is_checked_where_it_is_read_and_as_a_whole_by_who_completes_it(path, limits, monkeypatch):
    limits(400)
    monkeypatch.setattr("sweeps.storage.netcdf.CHECKED", 1000)
    large = sweep(GRID | {"x": list(np.arange(30.0))})
    large.plan(path, fresh=True).run("sync")
    with netCDF4.Dataset(path) as file:
        assert all(each.filters()["fletcher32"] for each in file.variables.values())
    flip_in(path, np.sqrt([2.0, 4.0]).tobytes())
    data = open_results(path)
    with pytest.raises(RuntimeError, match="HDF error"):
        data["root"].load()
    data.close()
    with pytest.raises(StoreError, match="its content is not what was written"):
        large.plan(path)
    large.plan(path, fresh=True).run("sync")
    flip_in(path, np.arange(30.0).tobytes())
    with pytest.raises(InputError, match="damaged"):
        open_results(path)


def test_a_file_that_is_shorter_than_a_seal(path):
    for content in (b"", b"\n", checked.SEAL, b"CDF"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="damaged"):
            open_results(path)
        with pytest.raises(StoreError, match="damaged"):
            sweep().plan(path)
