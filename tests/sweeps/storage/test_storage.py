"""Parts and the file at real size: what is read of them and when, what is kept in them, and how they are cut."""

import json
import os
import pickle
import time
import zlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sweeps import Axis, Grid, LockedError, Refinement, StoreError, Sweep, Variable, open_results, refined, status
from sweeps.compute.batch import BatchResult, Failure
from sweeps.compute.values import residual, scaled, unscaled
from sweeps.storage import lock
from sweeps.storage.netcdf import CHUNK_BYTES, chunk
from sweeps.storage.packed import HEAD, READ_AT_ONCE, Packed, pack
from sweeps.storage.parts import PartFolder, encode
from sweeps.storage.sources import NETCDF
from sweeps.storage.store import Store
from tests.helpers import waves
from tests.helpers.processes.sweep_programs import flip

LOG: list[float] = []


def with_words(data):
    data["state"].attrs |= {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": "apart stick slip"}
    return data.assign(mean=data["mean"].mean("side"))


@pytest.mark.parametrize("large", [34_000, 32_000])
def test_what_is_derived_of_a_variable_of_any_size_is_in_the_file(path, limits, large):
    limits(large, 1000, large)
    coords, grid = {"elapsed": Axis(np.arange(1000)), "side": Axis([0, 1])}, Grid({"x": Axis(np.arange(33))})
    variables = {"state": Variable(dims=("elapsed",), dtype="int8"), "mean": Variable(dims=("side",))}
    state = lambda p: {  # noqa: E731
        "state": np.tile(np.arange(1000) % 3, (len(p["x"]), 1)),
        "mean": p["x"][:, None] + [0.0, 1.0],
    }
    Sweep("contact", state, grid, variables, coords=coords, derive=with_words).plan(path).run()
    with xr.open_dataset(path, decode_cf=False) as plain:
        assert plain["state"].attrs["flag_meanings"] == "apart stick slip"
        assert plain["state"].attrs["flag_values"].tolist() == [0, 1, 2]
        assert plain["state"].dtype == np.int8
        assert plain["mean"].dims == ("x",)
        np.testing.assert_array_equal(plain["mean"], np.arange(33) + 0.5)


def motion(points):
    """A series of a unit load, as it is recorded."""
    LOG.extend((points["V"] / points["F"]).tolist())
    return {"series": np.sin(np.arange(5_000.0) * (points["V"] / points["F"])[:, None]).astype(np.float32)}


def motions(loads):
    axes = {"V": Axis(1e-3 * 2.0 ** np.arange(10), "m/s"), "F": Axis(loads, "N")}
    return Sweep(
        "motions",
        motion,
        Grid(axes),
        {"series": Variable("N", dims=("elapsed",), dtype="float32", digits=4, scale="load")},
        key=lambda points: points["V"] / points["F"],
        scale=lambda points: {"load": points["F"]},
        coords={"elapsed": Axis(np.arange(5_000))},
    )


def test_copies_of_large_results_are_not_computed_again(tmp_path, limits):
    limits(3_200_000, 1 << 18, 3_200_000)
    LOG.clear()
    path, loads = tmp_path / "m.nc", 3.0 * 2.0 ** np.arange(20)
    motions(loads).plan(path).run()
    assert len(LOG) == 29
    before = path.stat().st_size
    LOG.clear()
    grown = motions([*loads, 3.0 * 2.0**20])
    plan = grown.plan(path)
    assert (plan.distinct, plan.todo) == (30, 1)
    found = plan.run()
    assert len(LOG) == 1
    # The bits are those of a run that computes all of it.
    alone = grown.plan(tmp_path / "alone.nc").run()
    assert found["series"].values.tobytes() == alone["series"].values.tobytes()
    # What is kept for that takes little room.
    assert path.stat().st_size < 1.3 * before


@given(
    st.sampled_from(["float32", "float64"]).flatmap(
        lambda kind: hnp.arrays(kind, 5, elements=st.floats(width=32 if kind == "float32" else 64))
    ),
    st.floats(-1e3, 1e3),
    st.one_of(st.none(), st.integers(1, 15)),
)
@settings(max_examples=300, deadline=None)
def test_a_product_and_its_residual_are_the_value(values, factor, digits):
    factors = np.full(5, factor)
    with np.errstate(all="ignore"):
        product = scaled(values, factors, digits)
        again = unscaled(product, factors, digits, residual(values, factors, digits))
    assert again.tobytes() == values.tobytes()


@pytest.mark.parametrize(
    ("shape", "row"), [((21, 1000, 10), 8), ((5, 7), 8), ((1_000_000,), 8), ((300, 4), 1 << 16), ((3,), 1 << 24)]
)
def test_chunks_of_numbers_are_of_one_size_whatever_the_grid(shape, row):
    lengths = chunk(shape, (1000,), row)[:-1]
    assert all(1 <= length <= whole for length, whole in zip(lengths, shape, strict=True))
    taken = np.prod(lengths) * row
    assert taken <= max(CHUNK_BYTES, row)
    assert taken > CHUNK_BYTES / 4 or np.prod(lengths) in (1, np.prod(shape)) or row > CHUNK_BYTES / 8


def test_numbers_of_a_large_grid_are_in_large_chunks(tmp_path):
    axes = {"a": Axis(np.arange(3)), "b": Axis(np.arange(20_000)), "c": Axis(np.arange(10))}
    grid = Grid(axes)
    Sweep("wide", lambda p: {"y": 1.0 * p["a"] + p["c"]}, grid, {"y": Variable()}).plan(tmp_path / "w.nc").run()
    with open_results(tmp_path / "w.nc") as found:
        assert found["y"].encoding["chunksizes"] == (1, 3276, 10)
        assert found["error"].shape == grid.shape
        np.testing.assert_array_equal(found["y"].isel(b=-1), axes["a"].values[:, None] + 1.0 * axes["c"].values)
    assert (tmp_path / "w.nc").stat().st_size < 7e6


ARRAYS = st.dictionaries(
    st.text("abc _", min_size=1, max_size=4),
    st.sampled_from(["<f8", "<f4", "|i1", "<i8", "|b1", "<U3"]).flatmap(
        lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=4))
    ),
)


@given(ARRAYS, st.booleans())
@settings(max_examples=100, deadline=None)
def test_packed_arrays_come_back_bit_for_bit(tmp_path_factory, arrays, deflated):
    path = tmp_path_factory.mktemp("packed") / "file"
    path.write_bytes(pack({"about": 1}, arrays, arrays if deflated else ()))
    file = Packed(path)
    assert file.about == {"about": 1}
    for name, values in file.read(file.names).items():
        assert values.tobytes() == arrays[name].tobytes()
        assert (values.dtype, values.shape) == (arrays[name].dtype, arrays[name].shape)


def test_a_part_is_checked_when_it_is_read_and_not_before(tmp_path):
    folder = PartFolder(tmp_path)
    result = BatchResult({"y": np.random.default_rng(1).normal(size=100_000)}, np.ones(100_000))
    result.failures[7] = Failure("ValueError: no", "here", "again()")
    name = folder.next_name()
    folder.put(name, encode(result, 50 + np.arange(100_000), {"y": Variable()}, "token"))
    contents = folder.contents(name)
    assert (contents.points[0], contents.points[-1], contents.failed.tolist()) == (50, 100_049, [7])
    assert contents.seconds == 100_000.0
    found = folder.read(name, ["y"])
    np.testing.assert_array_equal(found.values["y"], result.values["y"])
    assert found.failures == result.failures
    flip(tmp_path / name, -1000)
    assert folder.contents(name) is not None
    assert folder.read(name, []) is not None
    assert folder.read(name, ["y"]) is None
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-1])
    assert folder.contents(name) is None


def series(points):
    LOG.extend(points["x"].tolist())
    return {"y": points["x"][:, None] + np.arange(100_000.0)}


def recorded(count=6, function=series, length=100_000, **variable):
    """A sweep of series."""
    grid, coords = Grid({"x": Axis(np.arange(float(count)))}), {"elapsed": Axis(np.arange(length))}
    return Sweep("recorded", function, grid, {"y": Variable(dims=("elapsed",), **variable)}, coords=coords)


@pytest.mark.parametrize("spoil", [lambda part: flip(part, -1000), lambda part: os.truncate(part, 1000)])
def test_a_part_that_rots_costs_its_points_and_no_more(path, spoil):
    waves.interrupted(recorded().plan(path), 3)
    store = Store(path)
    name = store.folder.names()[-1]
    lost = store.folder.contents(name).points
    plan = recorded().plan(path)
    spoil(store.parts / name)
    LOG.clear()
    # A reader leaves out what is damaged; a run finds it when it writes the file, and the next computes it again.
    assert np.all(open_results(store.file)["status"].values[lost] == 0)
    with pytest.raises(StoreError, match=f"{name} in .* got damaged; plan and run again"):
        plan.run("sync")
    assert not set(LOG) & set(lost.tolist())
    LOG.clear()
    found = recorded().plan(store.file).run("sync")
    assert lost.tolist() == LOG
    np.testing.assert_array_equal(found["y"], series(recorded().grid.points())["y"])


def test_status_of_ten_gigabytes_of_parts_reads_their_headers(tmp_path):
    sweep = recorded(30_000, length=50_000)
    plan = sweep.plan(tmp_path / "r.nc")
    store = Store(plan.store)
    store.parts.mkdir()
    plan.manifest.save(store.manifest)
    # As a run of 25 000 points leaves them, but for the values: the files have holes in their place.
    for begin in range(0, 25_000, 30):
        points = begin + np.arange(30)
        result = BatchResult({"y": np.zeros((30, 1))}, np.full(30, 0.5))
        content = encode(result, points, sweep.variables, plan.manifest.token)
        _, length, _ = HEAD.unpack_from(content)
        header = json.loads(content[HEAD.size : HEAD.size + length])
        header["arrays"]["value_y"] = ["<f8", [30, 50_000], "raw", header["arrays"]["value_y"][3], 12_000_000, 0]
        name = store.folder.next_name()
        with open(store.parts / name, "wb") as file:
            file.write(_headed(header))
            file.truncate(file.tell() + header["arrays"]["value_y"][3] + 12_000_000)
    assert sum(path.stat().st_size for path in store.parts.iterdir()) > 10e9
    begin = time.process_time()
    found = status(store.file)
    assert time.process_time() - begin < 1.0
    assert (found.state, found.done, found.pending) == ("interrupted", 25_020, 4_980)
    again = sweep.plan(store.file)
    assert (again.todo, again.cached) == (4_980, 25_020)
    assert again.seconds == pytest.approx(0.5 * 4_980)


def _headed(header):
    text = json.dumps(header).encode()
    return HEAD.pack(b"sweeps-1", len(text), zlib.crc32(text)) + text


def test_of_many_that_want_the_lock_one_has_it_at_a_time(tmp_path):
    store, inside, most = Store(tmp_path / "a.nc"), [0], [0]

    def hold(_):
        for _ in range(20):
            try:
                with lock.locked(store):
                    inside[0] += 1
                    most[0] = max(most[0], inside[0])
                    time.sleep(0.001)
                    inside[0] -= 1
            except StoreError:
                continue

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(hold, range(4)))
    assert most == [1]
    assert os.listdir(tmp_path) == []


def test_the_lock_removes_no_file_but_its_own_and_nobody_writes_into_it(tmp_path):
    store = Store(tmp_path / "a.nc")
    with lock.locked(store):
        assert store.lock.read_bytes() == b""
        assert lock.is_locked(store)
        assert f"process {os.getpid()} on " in str(lock.taken(store))
        store.lock.unlink()
        assert not lock.is_locked(store)
        store.lock.write_bytes(b"another run's")
    assert store.lock.read_bytes() == b"another run's"
    with lock.locked(store), pytest.raises(LockedError, match=f"process {os.getpid()} on "), lock.locked(store):
        pass
    assert os.listdir(tmp_path) == []


def test_a_lock_whose_file_is_removed_while_it_is_waited_for_is_not_taken(tmp_path, monkeypatch):
    store, files = Store(tmp_path / "a.nc"), []

    def slow(descriptor, blocking):
        # The run before ends between our opening the file and locking it.
        if not files:
            store.lock.unlink()
        files.append(os.fstat(descriptor).st_ino)
        return True

    monkeypatch.setattr(lock, "lock_descriptor", slow)
    with lock.locked(store):
        assert len(files) == 2
        assert store.lock.stat().st_ino == files[1]
    assert os.listdir(tmp_path) == []


def test_a_disk_without_locks_is_refused(tmp_path, monkeypatch):
    def missing(descriptor, blocking):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(lock, "lock_descriptor", missing)
    with pytest.raises(StoreError, match=r"a.nc cannot be written: Function not implemented; choose another"):
        recorded(1).plan(tmp_path / "a.nc").run("sync")


def test_flags_of_a_variable_are_those_of_cf(tmp_path):
    flags = {np.int64(0): "not asked", 1: "done", 7: "lost"}
    variable = Variable("1", "state", dtype="int8", flags=flags)
    grid = Grid({"x": Axis([0, 1, 7])})
    sweep = Sweep("flagged", lambda p: {"s": p["x"]}, grid, {"s": variable})
    waves.interrupted(sweep.plan(tmp_path / "f.nc"), 1)
    # A file that is not finished has them as well.
    assert open_results(tmp_path / "f.nc")["s"].attrs["flag_meanings"] == "not_asked done lost"
    sweep.plan(tmp_path / "f.nc").run()
    with xr.open_dataset(tmp_path / "f.nc", mask_and_scale=False) as found:
        assert found["s"].attrs["flag_meanings"] == "not_asked done lost"
        assert found["s"].attrs["flag_values"].tolist() == [0, 1, 7]
        assert found["s"].attrs["flag_values"].dtype == found["s"].dtype == np.int8
        assert "units" not in found["s"].attrs


def test_a_refined_sweep_computes_again_what_rots(path):
    def sweep():
        axis = Axis(np.linspace(0.0, 1.0, 257))
        disc = lambda points: {"r": np.hypot(points["x"], points["y"])}  # noqa: E731
        whole = Sweep("disc", disc, Grid({"x": axis, "y": axis}), {"r": Variable()}, batch_multiple=20_000)
        return refined(whole, Refinement("r", 1, thresholds=(0.5,)))

    waves.interrupted(sweep().plan(path), 16_000)
    part = next(Store(path).parts.glob("*.part"))
    assert part.stat().st_size > READ_AT_ONCE
    flip(part, -50)
    plan = sweep().plan(path)
    assert plan.damaged == (part.name,)
    found = plan.run("sync")
    for name in ("r", "status"):
        np.testing.assert_array_equal(found[name], sweep().plan().run("sync")[name])


def test_parts_outlast_a_manifest_that_cannot_be_read_now(path, monkeypatch):
    def full(path):
        raise OSError(24, "Too many open files")

    waves.interrupted(recorded().plan(path), 3)
    store, names, cached = Store(path), Store(path).folder.names(), recorded().plan(path).cached
    with monkeypatch.context() as patched:
        patched.setattr("sweeps.storage.manifest.Packed", full)
        with pytest.raises(StoreError, match=r"manifest cannot be read: Too many open files"):
            recorded().plan(store.file)
    assert store.folder.names() == names
    assert recorded().plan(store.file).cached == cached > 0


def test_a_result_is_read_while_another_is_written(tmp_path, limits):
    limits(400_000, 1 << 18, 400_000)
    assert pickle.loads(pickle.dumps(NETCDF)) is NETCDF  # noqa: S301 - our own lock

    def sweep(count):
        return recorded(count, lambda p: {"y": p["x"][:, None] + np.arange(1000.0)}, 1000, digits=4)

    data, reads = sweep(200).plan(tmp_path / "a.nc").run("sync"), 0
    assert not data["y"].variable._in_memory
    expected, end = data["y"].values, time.monotonic() + 0.8

    def write():
        while time.monotonic() < end:
            sweep(210).plan(tmp_path / "b.nc", fresh=True).run("sync").close()
        return True

    with ThreadPoolExecutor(1) as other:
        written = other.submit(write)
        while time.monotonic() < end:
            np.testing.assert_array_equal(data["y"].values, expected)
            reads += 1
        assert written.result()
    assert reads > 1
