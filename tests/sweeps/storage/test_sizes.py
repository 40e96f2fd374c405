"""Sizes that files declare: looked at before anything is allocated for them."""

import json
import resource
import time
import zlib
from contextlib import contextmanager

import netCDF4
import numpy as np
import pytest

from sweeps import StoreError, open_results, status
from sweeps.storage.packed import HEAD, MAGIC, pack
from sweeps.storage.parts import PartFolder
from tests.helpers.waves import sweep

# Entries along both dimensions of a variable of a byte each: 3.6 GB.
LONG = 60_000


@contextmanager
def at_once():
    """Less than a second, and less than 200 MB."""
    before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    yield
    assert time.monotonic() - begin < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def declared(path, name, dims):
    """The result of a sweep whose variable of a name has other dimensions, of which nothing is written."""
    sweep().plan(path).run()
    whole = path.read_bytes()
    with netCDF4.Dataset("whole", memory=whole) as old, netCDF4.Dataset(path, "w") as new:
        for each in (old, new):
            each.set_auto_chartostring(False)
        new.setncatts(vars(old))
        for dim in old.dimensions.values():
            new.createDimension(dim.name, len(dim))
        new.createDimension("long", LONG)
        new.createDimension("longer", LONG)
        for each in old.variables.values():
            wanted = dims if each.name == name else each.dimensions
            made = new.createVariable(each.name, each.dtype, wanted, zlib=True)
            made.setncatts({key: value for key, value in vars(each).items() if key != "_FillValue"})
            if each.name != name:
                made[...] = each[...]
    assert path.stat().st_size < 1_000_000


@pytest.mark.parametrize(
    ("name", "dims"), [("status", ("long", "longer")), ("root", ("long", "longer")), ("row", ("x", "y", "long"))]
)
def test_a_small_file_that_declares_a_large_variable(path, name, dims):
    declared(path, name, dims)
    for ask in (open_results, status):
        with (
            at_once(),
            pytest.raises(ValueError, match=rf"sweep.nc: it is damaged: {name} has the shape .* 60000"),
        ):
            ask(path)
    for fresh in (sweep(), sweep({"x": [1.0, 2.0, 3.0, 4.0], "y": [1.0, 3.0]})):
        with at_once(), pytest.raises(StoreError, match=rf"sweep.nc is damaged .{name} has the shape .* 60000"):
            fresh.plan(path)


@pytest.mark.parametrize("deflated", [False, True])
def test_a_part_that_declares_large_arrays(tmp_path, deflated):
    """Of which a few bytes are stored: of equal entries one alone, of others what is left of them."""
    path, about = tmp_path / "000001-00000000.part", {"manifest": "a", "rows": 99, "seconds": 0.0}
    content = pack(about, {"steps": np.arange(99) if deflated else np.ones(99, np.int64)}, ["steps"])
    for wrong in (about | {"rows": 10**15, "first": 0}, about):
        header = json.loads(content[HEAD.size : HEAD.size + HEAD.unpack_from(content)[1]])
        header["about"], header["arrays"]["steps"][1] = wrong, [10**13]
        if "first" in wrong:
            header["arrays"] = {}
        text = json.dumps(header).encode()
        blobs = content[HEAD.size + HEAD.unpack_from(content)[1] :] if header["arrays"] else b""
        path.write_bytes(HEAD.pack(MAGIC, len(text), zlib.crc32(text)) + text + blobs)
        with at_once():
            assert PartFolder(tmp_path).contents(path.name) is None
