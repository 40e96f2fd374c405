"""Starts about steady sliding, shares with their intervals, and the smallest knock that starts vibration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from fivcore import Friction, Rig, Scene, State, Structure, equilibrium, simulate, sliding_modes
from studies.asking.sweep import sweep_of
from studies.declaring.parameters import RUN
from studies.gallery import maps
from studies.motion import following, knock, starts
from studies.motion.jobs import each_scene
from studies.physics.classical import block_of

OPTIONS = {"duration": None, "step": None, "cutoff": None, "numerical_damping": "none"}
SCENE = Scene(5e-3, 5.0, 0.1, 9.0)


@pytest.mark.parametrize("friction", [Friction(), Friction(0.9, 0.01)])
def test_a_start_in_steady_sliding_stays_there(friction):
    q = equilibrium(scene := Scene(0.02, 5.0, 0.05, 9.0, friction=friction))
    run = simulate(scene, 0.02, initial=State.of(scene, q, 0.0 * q), settle=0.0, record=True)
    np.testing.assert_allclose(run.normal_force, 9.0, rtol=1e-4)
    np.testing.assert_allclose(run.slip_velocity, -0.02, rtol=1e-3)
    np.testing.assert_allclose(run.tangential_force, 0.05 * friction.ratio(0.02) * run.normal_force, rtol=1e-4)


@pytest.mark.parametrize("name", ["displacement", "velocity"])
@pytest.mark.parametrize("number", [3, 5])
def test_a_start_along_a_mode_moves_as_the_mode(name, number):
    modes = sliding_modes(Rig(), 5.0, 0.1)
    phi = complex(modes.growth_rate[number - 1], 2.0 * np.pi * modes.frequency[number - 1])
    q, v = starts.directions(SCENE, [name], number)[0]
    size = 1e-4 / (abs(phi) if name == "displacement" else 1.0)
    start = State.of(SCENE, equilibrium(SCENE) + size * q, size * v)
    run = simulate(SCENE, 0.01, initial=start, settle=0.0, record=True, sample_rate=None)
    a = complex(1.0, phi.real / phi.imag) if name == "displacement" else -1j / phi.imag
    expected = size * (a * phi * np.exp(phi * run.time)).real
    np.testing.assert_allclose(run.velocity_B, expected, atol=0.02 * np.abs(expected).max())


def test_a_knock_gives_P1_its_momentum_and_a_lift_its_speed():
    q, v = starts.directions(SCENE, ["knock", "velocity_C"])[:, 1]
    rigid = np.flatnonzero(Structure.of(Rig(), 5.0).stiffness == 0.0)
    normal = Structure.of(Rig(), 5.0).normal
    assert q[rigid] * normal[rigid] == pytest.approx(-(normal[rigid] ** 2))
    assert v @ normal == pytest.approx(1.0)


def test_draws_are_the_same_at_all_points_and_end_when_shares_are_known(computed):
    data = computed("basins", mu=[0.08, 0.1], V=5e-3, most=40, width=0.2).squeeze()
    few, many = data.sel(mu=0.08), data.sel(mu=0.1)
    assert (int(few["draws"]), int(many["draws"])) == (16, 40)
    assert np.all(few["label"][16:] == -1)
    assert np.all(np.isnan(few["start_knock"][16:]))
    np.testing.assert_array_equal(few["start_knock"][:16], many["start_knock"][:16])
    assert np.abs(many["start_knock"]).max() < 6e-4
    assert float(many["share"].sum()) == pytest.approx(1.0)
    for share, low, high in zip(*(many[f"share{end}"].values for end in ("", "_low", "_high")), strict=True):
        interval = binomtest(round(40 * share), 40).proportion_ci(method="wilson")
        assert (low, high) == pytest.approx(tuple(interval), abs=1e-12)
    other = computed("basins", mu=0.1, V=5e-3, most=16, seed=1, duration=0.2).squeeze()
    assert not np.any(np.isin(other["start_knock"], many["start_knock"]))


def test_a_plane_has_all_combinations_and_no_interval(computed):
    plane = {"knock": [-3e-4, 0.0, 5e-4], "velocity_C": [0.0, 1e-3], "starts_are": "plane", "duration": 0.2}
    data = computed("basins", mu=0.1, V=5e-3, **plane).squeeze()
    assert data.sizes["draw"] == 6
    assert data["start_velocity_C"].values.tolist() == 3 * [0.0] + 3 * [1e-3]
    assert np.isnan(data["vibration_share_low"])
    alone = equilibrium(SCENE) + 0.0, 5e-4 * starts.directions(SCENE, ["knock"])[0, 1]
    label = starts.labels_of(SCENE, [State.of(SCENE, *alone)], OPTIONS | {"duration": 0.2})
    assert label[0] == data["label"][2]


@pytest.mark.parametrize(("values", "message"), [
    ({"mode": 99}, "mode = 99: steady sliding has"),
    ({"velocity_C": 0.1, "rig": None}, "velocity_C: without a rigid motion"),
])  # fmt: skip
def test_starts_that_cannot_be_are_refused(values, message):
    held = Structure.from_modes([1.0, 2.0], [1.0, 0.5], [0.2, 1.0], load=[-1.0, 0.0])
    scene = Scene(0.1, 0.0, 0.1, 1.0, held) if "rig" in values else SCENE
    with pytest.raises(ValueError, match=message):
        starts.directions(scene, ["velocity_C" if "rig" in values else "velocity"], values.get("mode", 0))


def test_the_smallest_knock_starts_vibration_and_scales_with_the_load():
    found = knock.threshold(SCENE, 1e-4, 0.05, OPTIONS)
    half = np.sqrt(3.0) * found["knock_threshold_se"]
    assert half <= 0.025 * (found["knock_threshold"] + half)
    q, v = equilibrium(SCENE), starts.directions(SCENE, ["knock"])[0, 1]
    ends = [State.of(SCENE, q, (found["knock_threshold"] + sign * half) * v) for sign in (-1.0, 1.0)]
    assert [int(label) > 2 for label in starts.labels_of(SCENE, ends, OPTIONS)] == [False, True]
    study = maps.STUDIES["knock"]
    given = {"V": 2.5e-3, "F": 4.5, "mu": [0.1, 0.12], "resolution": 0.05, "largest_knock": 1e-4}
    data = sweep_of(study, given).plan().run("sync")["knock_threshold"].squeeze()
    assert float(data.sel(mu=0.1)) == pytest.approx(0.5 * found["knock_threshold"])
    assert np.all(np.isnan(data.sel(mu=0.12)))


@pytest.mark.parametrize("scatter", [0.0, 0.3])
def test_a_knock_threshold_that_scatters_says_so(scatter, monkeypatch):
    """As if starts with the same first nine digits moved differently: vibration from a random limit on."""

    def labels(scene, states, options):
        sizes = [np.asarray(state.velocity) @ v / (v @ v) for state in states]
        limits = [1e-4 * (1.0 + scatter * (hash(size) % 1000 / 1000.0)) for size in sizes]
        return np.array([4 if size > limit else 2 for size, limit in zip(sizes, limits, strict=True)])

    v = starts.directions(SCENE, ["knock"])[0, 1]
    monkeypatch.setattr(starts, "labels_of", labels)
    found, error = knock.threshold(SCENE, 1e-3, 1e-3, OPTIONS).values()
    assert error < 1e-7 if not scatter else 1e-6 < error < 1e-5
    assert found == pytest.approx(1e-4, abs=error + scatter * 1e-4)


def test_a_structure_of_few_modes_has_basins_too(computed):
    from studies import registry

    law = {"kinetic_ratio": 0.5, "decay_speed": 0.5, "mu": 1.0, "F": 1.0, "V": 1.7, "duration": 500.0}
    given = law | {"knock": 0.0, "velocity": [0.0, 2.5], "most": 16}
    own = block_of(1.0, 0.05).to_dict()
    data = sweep_of(registry.load("basins"), given, structure=own).plan().run("sync").squeeze()
    assert 0.0 < float(data["vibration_share"]) < 1.0
    assert np.all(data["start_velocity"].values[data["label"].values > 2] > 1.4)


def mirror_images():
    """A structure of three modes: at V < 0 it slides steadily and vibrates at V > 0."""
    own = Structure.from_modes(
        [500.0, 800.0, 1700.0], [0.4, 0.1, 0.4], [-0.9, -0.7, -0.4], load=[-0.4, -0.1, 0.0], damping_ratio=0.002
    )
    return (
        Scene(-2e-2, 0.0, 0.3, 50.0, own),
        Scene(2e-2, 0.0, 0.3, 50.0, own.mirrored()),
        Scene(2e-2, 0.0, 0.3, 50.0, own),
    )


def basin(scene):
    def labels(seen):
        q, (_, v) = equilibrium(seen), starts.directions(seen, ["knock"])[0]
        states = [State.of(seen, q, size * v) for size in (-1e-3, 1e-3, 1e-2)]
        return {"label": starts.labels_of(seen, states, OPTIONS | {"duration": 0.3})}

    return each_scene([scene], labels)["label"].tolist()


def knocked(scene):
    return knock.knocks([scene], 1e-3, 0.2, **OPTIONS | {"duration": 0.3})["knock_threshold"].tolist()


def followed(scene):
    found = following.follow(
        [(scene, replace(scene, mu=0.32))], 1.0, 0.2, **{name: each.default for name, each in RUN.items()}
    )
    return np.nan_to_num(np.abs(found["velocity_rms"]), nan=-1.0).tolist()


@pytest.mark.parametrize("study", [basin, knocked, followed])
def test_a_structure_at_v_below_zero_is_its_mirror_image(study):
    here, image, other = (study(scene) for scene in mirror_images())
    assert here == image
    assert here != other
