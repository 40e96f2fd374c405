"""Structures with several contacts: how they are given, what is refused, what a run says about each contact."""

import numpy as np
import pytest
from scipy import io, sparse

from fivcore import (
    ContactError,
    Friction,
    InputError,
    Scene,
    State,
    Structure,
    flutter_onsets,
    glued_frequencies,
    limit_cycle,
    lyapunov_exponent,
    painleve_mu,
    simulate,
    sliding_modes,
    sliding_onsets,
)
from fivcore.stability.several import crossings
from fivcore.transient.fast.several import SeveralRun
from tests.helpers.several import drawn, paper_rig, repeated, two_beams

BLOCK = {"frequency": [0.0, 0.0, 50.0], "tangential": [[0.0, 0.0, 1.0]] * 2, "load": [-1.0, 0.0, 0.0]}
# A block of mass 1 and length 2 on both its ends.
ENDS = [[1.0, -1.7, 0.0], [1.0, 1.7, 0.0]]


def springs(gap=None, **given):
    """A chain of three masses over three supports."""
    K = 1e4 * (2.0 * np.eye(6) - np.eye(6, k=2) - np.eye(6, k=-2))
    rows = {"normal": [{0: 1.0}, {2: 1.0}, {4: 1.0}], "tangential": [{1: 1.0}, {3: 1.0}, {5: 1.0}]}
    load = {0: -1.0, 2: -1.0, 4: -1.0}
    return Structure.from_matrices(np.eye(6), K, **rows | {"load": load, "gap": gap} | given)


def test_one_contact_in_a_list_is_one_contact():
    rows = {"frequency": [0.0, 1.0], "load": [-1.0, 0.0]}
    one = Structure.from_modes(normal=[1.0, 0.0], tangential=[0.0, 1.0], **rows)
    listed = Structure.from_modes(normal=[[1.0, 0.0]], tangential=[[0.0, 1.0]], gap=0.0, friction=[1.0], **rows)
    assert listed == one
    assert listed.contacts == 1
    assert "gap" not in listed.to_dict()


def test_rows_gaps_and_friction_by_any_way():
    own = springs([0.0, 1e-4, 0.0], friction=[1.0, 0.5, 1.0])
    again = Structure.from_dict(own.to_dict())
    assert again == own
    assert again != springs([0.0, 2e-4, 0.0], friction=[1.0, 0.5, 1.0])
    rows = [np.eye(6)[row].tolist() for row in (0, 2, 4)]
    assert springs([0.0, 1e-4, 0.0], friction=[1.0, 0.5, 1.0], normal=rows) == own
    assert own.mirrored().mirrored() == own
    assert np.array_equal(own.with_gap(np.zeros(3)).gap, np.zeros(3))


def test_the_load_decides_which_contacts_are_closed():
    # The middle mass moves by 0.5e-4 m a newton of each support's load before it closes.
    own = springs([0.0, 1e-4, 0.0])
    forces, gaps = own.equilibrium(1.0)
    assert forces == pytest.approx([1.5, 0.0, 1.5])
    assert gaps == pytest.approx([0.0, 0.5e-4, 0.0])
    forces, gaps = own.equilibrium(3.0)
    assert forces == pytest.approx([4.0, 1.0, 4.0])
    assert gaps == pytest.approx(np.zeros(3), abs=1e-18)


@pytest.mark.parametrize("convert", [np.asarray, sparse.csc_array])
def test_compliance_of_modes_that_are_not_computed(convert, monkeypatch):
    whole = two_beams(3)
    for module in ("structure", "finite_elements"):
        monkeypatch.setattr(f"fivcore.{module}.DENSE_SIZE", 10 if convert is not np.asarray else 600)
    few = two_beams(3, fmax=10e3)
    assert few.static > 0
    assert len(few.frequency) < len(whole.frequency)
    for F in (1.0, 9.0):
        for one, other in zip(few.equilibrium(F), whole.equilibrium(F), strict=True):
            assert one == pytest.approx(other, abs=1e-6 * F)


CHAIN = """
mass = "M.mtx"
stiffness = "K.mtx"
dofs_per_node = 2
load = {"node 1, x" = -1.0, "node 2, x" = -1.0, "node 3, x" = -1.0}
"""
LISTED = """
[[contacts]]
normal = "node 1, x"
tangential = "node 1, y"
[[contacts]]
normal = {"node 2, x" = 1.0}
tangential = "node 2, y"
gap = 1e-4
[[contacts]]
normal = 4
tangential = 5
friction = 0.5
"""


def chain_file(folder, text):
    io.mmwrite(folder / "M.mtx", sparse.coo_array(np.eye(6)))
    io.mmwrite(folder / "K.mtx", sparse.coo_array(1e4 * (2.0 * np.eye(6) - np.eye(6, k=2) - np.eye(6, k=-2))))
    (folder / "pad.toml").write_text(text)
    return folder / "pad.toml"


def test_a_file_lists_its_contacts(tmp_path):
    own = Structure.read(chain_file(tmp_path, CHAIN + LISTED))
    assert own == springs([0.0, 1e-4, 0.0], friction=[1.0, 1.0, 0.5])
    rows = 'normal = ["node 1, x", "node 2, x", 4]\ntangential = [1, 3, 5]\ngap = [0.0, 1e-4, 0.0]\n'
    assert Structure.read(chain_file(tmp_path, CHAIN + rows)) == springs([0.0, 1e-4, 0.0])
    pairs = 'contacts = {pairs = [[1, 2], [3, 2]], normal = "x", tangential = "y", friction = [1.0, 0.5]}\n'
    own = Structure.read(chain_file(tmp_path, CHAIN.replace('1, x" = -1.0', '1, x" = -2.0') + pairs))
    assert own.contacts == 2
    assert own.friction == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LISTED + "[[contacts]]\nnormal = 1\n", "tangential: it is missing"),
        (LISTED + "[[contacts]]\nnormal = 1\ntangential = 2\nslope = 3\n", "slope: there is none"),
        ("gap = 0.0\n" + LISTED, "gap is given beside"),
        ('contacts = {pairs = [[1, 9]], normal = "x", tangential = "y"}\n', "node 9, x"),
        ('contacts = {pairs = [1, 2], normal = "x", tangential = "y"}\n', "contacts"),
        ("contacts = 3\n", "contacts"),
    ],
)
def test_a_wrong_list_of_contacts_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        Structure.read(chain_file(tmp_path, CHAIN + text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"normal": ENDS, "load": [-1.0, 3.0, 0.0]}, "load: with it the structure moves away or turns over"),
        ({"normal": ENDS, "load": [1.0, 0.0, 0.0]}, "load: with it the structure moves away"),
        ({"normal": [ENDS[0]] * 2}, "rigid motion"),
        ({"normal": ENDS, "gap": [0.0, -1e-6]}, "gap = -1e-06"),
        ({"normal": ENDS, "gap": [0.0, 0.0, 0.0]}, "gap of shape"),
        ({"normal": ENDS, "friction": [1.0, 0.0]}, "friction = 0"),
        ({"normal": ENDS, "tangential": [0.0, 0.0, 1.0]}, "tangential of shape"),
        ({"normal": [[1.0, -1.7, 0.0], [1.0, 1.7]]}, "normal of shape"),
    ],
)
def test_wrong_contacts_are_refused_in_one_line(given, message):
    with pytest.raises(InputError, match=message) as caught:
        Structure.from_modes(**BLOCK | given)
    assert "\n" not in str(caught.value)


def test_what_needs_one_contact_says_so():
    own = drawn(2)
    scene = Scene(0.02, 0.0, 0.3, 10.0, own)
    calls = [(call, (scene, 0.1)) for call in (lyapunov_exponent, limit_cycle)]
    for method in ("exact", "paper"):
        calls += [(simulate, (scene, 0.1, method)), (painleve_mu, (own, 0.0, method))]
    for call, given in calls:
        with pytest.raises(InputError, match=r"touches in 5 places; [^\n]* one contact[^\n]*$"):
            call(*given)
    with pytest.raises(ContactError, match="not unique"):
        simulate(Scene(0.02, 0.0, 3.0, 10.0, own), 0.1)


def test_tied_frequencies_of_contacts_in_one_place():
    own = paper_rig()
    assert glued_frequencies(repeated(own), 0.0, 5) == pytest.approx(glued_frequencies(own, 0.0, 5), rel=1e-5)


def test_a_run_says_what_each_contact_does():
    own, F = drawn(2), 10.0
    scene = Scene(0.02, 0.0, 0.6, F, own)
    found = simulate(scene, 0.3, settle=0.05, ramp=0.0, record=True, sample_rate=None)
    late = found.time >= 0.05
    for code, name in enumerate(("separation", "stick", "slip")):
        assert found.summary[f"contact_{name}_fraction"] == pytest.approx(
            (found.contact_state[late] == code).mean(axis=0), abs=1e-3
        )
    assert found.summary["contact_mean_normal_force"] == pytest.approx(
        found.contact_normal_force[late].mean(axis=0), rel=1e-3
    )
    assert found.normal_force == pytest.approx(found.contact_normal_force.sum(axis=1), abs=1e-9 * F)
    assert found.summary["contact_max_normal_force"].max() >= found.contact_normal_force[late].max() * (1 - 1e-12)
    away, slides = (found.contact_state == 0).all(axis=1), (found.contact_state == 2).any(axis=1)
    assert np.array_equal(found.state, np.where(away, 0, np.where(slides, 2, 1)))
    opened, stuck = (found.contact_state == 0).any(axis=1), (found.contact_state == 1).all(axis=1)
    assert found.summary["any_open_fraction"] == pytest.approx(opened[late].mean(), abs=1e-3)
    assert found.summary["all_stick_fraction"] == pytest.approx(stuck[late].mean(), abs=1e-3)
    limit = 0.6 * own.friction * found.contact_normal_force
    assert np.all(np.abs(found.contact_tangential_force) <= limit * (1.0 + 1e-9) + 1e-12)
    assert np.all(found.contact_normal_force >= 0.0)
    # In rigid contact slip may end a step after its rate has passed zero.
    power = found.contact_tangential_force * found.contact_slip_velocity
    assert np.maximum(power, 0.0).sum() < 1e-3 * np.abs(power).sum()


def test_a_run_goes_on_with_the_same_bits():
    own = drawn(2)
    scene, given = (
        Scene(0.02, 0.0, 0.6, 10.0, own),
        {"ramp": 0.0, "record": True, "sample_rate": None, "step": 1e-5},
    )
    whole = simulate(scene, 0.12, **given)
    first = simulate(scene, 0.05, **given)
    second = simulate(
        scene, 0.07, **{name: given[name] for name in given if name != "ramp"}, initial=first.final_state
    )
    for name in ("velocity_B", "contact_normal_force", "contact_state"):
        assert np.array_equal(np.concatenate([getattr(first, name), getattr(second, name)]), getattr(whole, name))


def test_a_load_that_closes_no_contact_is_refused():
    own = springs([1e-3, 1e-3, 1e-3])
    with pytest.raises(InputError, match=r"F = 1: no contact is closed; the least gap is 0\.0008 m"):
        own.equilibrium(1.0)
    with pytest.raises(InputError, match="F = 1: it closes none of 3 contacts"):
        simulate(Scene(0.02, 0.0, 0.3, 1.0, own), 0.1)
    with pytest.raises(InputError, match="F is missing"):
        flutter_onsets(own, 0.0)
    with pytest.raises(InputError, match="no contact is closed"):
        flutter_onsets(own, 0.0, F=1.0)


def test_one_contact_with_a_gap_is_as_several():
    own = Structure.from_modes(
        [5.0, 50.0], [[1.0, 0.2]], [[0.1, 1.0]], load=[-1.0, 0.0], gap=1e-5, damping_ratio=0.01
    )
    assert own.contacts == 1
    closing = 1e-5 * own.stiffness[0]
    with pytest.raises(InputError, match="no contact is closed"):
        own.equilibrium(0.9 * closing)
    found = simulate(Scene(0.02, 0.0, 0.3, 10.0 * closing, own), 0.5, settle=0.1)
    assert found.summary["contact_separation_fraction"].shape == (1,)
    assert found.summary["energy_residual"] < 1e-2
    with pytest.raises(InputError, match="with a gap"):
        lyapunov_exponent(Scene(0.02, 0.0, 0.3, 10.0 * closing, own), 0.1)


def test_a_state_says_which_contacts_are_open():
    own = springs([0.0, 1e-4, 0.0])
    q = np.linalg.solve(np.diag(own.stiffness), own.load + own.equilibrium(1.0)[0] @ own.normal)
    state = State.of(Scene(0.02, 0.0, 0.3, 1.0, own), q, np.zeros(6))
    assert state.statuses.tolist() == [2, 0, 2]
    assert state.contact == 2
    found = simulate(Scene(0.02, 0.0, 0.3, 1.0, own), 0.01, initial=state, record=True, sample_rate=None)
    assert found.contact_state[0].tolist() == [2, 0, 2]
    wrong = State(q, np.zeros(6), 1, True, np.array([1, 1]))
    with pytest.raises(InputError, match="they must be 3"):
        simulate(Scene(0.02, 0.0, 0.3, 1.0, own), 0.01, initial=wrong)


def test_onsets_along_friction_and_speed():
    own, friction = drawn(9), Friction(0.5, 0.05)
    for parameter, low, high in (("mu", 0.1, 1.0), ("V", 0.01, 1.0)):
        found = sliding_onsets(Scene(0.1, 0.0, 0.5, 10.0, own, friction), parameter, low, high, 2e3)
        for value, change in zip(found.value, found.change, strict=True):
            rates = []
            for each in (value * (1.0 - 1e-5), value * (1.0 + 1e-5)):
                at = {"mu": 0.5, "V": 0.1} | {parameter: each}
                given = {"friction": friction, "V": at["V"], "F": 10.0}
                rates.append(np.sum(sliding_modes(own, 0.0, at["mu"], 2e3, **given).growth_rate > 0.0))
            assert rates[1] - rates[0] == change


def test_initial_gaps_make_a_scene_depend_on_its_load():
    own = springs([0.0, 1e-4, 0.0], d1=20.0)
    light, heavy = (simulate(Scene(0.02, 0.0, 0.3, F, own), 0.5, settle=0.1) for F in (1.0, 3.0))
    assert light.summary["contact_separation_fraction"] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert heavy.summary["contact_separation_fraction"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert heavy.summary["contact_mean_normal_force"] == pytest.approx([4.0, 1.0, 4.0], rel=0.05)
    twice = simulate(Scene(0.04, 0.0, 0.3, 2.0, own.with_gap(2.0 * own.gap)), 0.5, settle=0.1)
    assert twice.summary["contact_mean_normal_force"] == pytest.approx(
        2.0 * light.summary["contact_mean_normal_force"], rel=1e-9
    )


def test_the_run_of_several_contacts_is_chosen_by_their_number():
    assert isinstance(simulate(Scene(0.02, 0.0, 0.3, 1.0, springs()), 0.01).final_state.origin[1], SeveralRun)


def test_a_rate_that_is_constant_within_rounding_is_not_followed():
    rng, places = np.random.default_rng(0), []

    def at(mu):
        places.append(mu)
        return np.array([-0.01 * (1.0 + 1e-12 * rng.normal()) + 0.5j, 0.1 * (mu - 0.55) + 0.2j])

    grid = np.linspace(0.0, 1.0, 97).tolist()
    onsets, *_ = crossings(at, grid)
    assert onsets == [pytest.approx((0.55, 0.2))]
    assert len(places) < 2 * len(grid)


@pytest.mark.parametrize("damping", [{"d1": 20.0, "d2": 1e-7}, {"damping_ratio": 0.002}])
def test_a_rigid_foot_slides_alike_on_two_contacts_and_on_more(damping):
    """With three contacts in a row on one body the forces are not unique, but the motion is."""
    rng = np.random.default_rng(3)
    low, turn, along = rng.normal(size=(3, 8))
    frequency, load = np.sort(rng.uniform(100.0, 4000.0, 8)), -(low + 0.1 * turn)
    found = []
    for arms in ([-1.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, -0.3, 0.4, 1.0]):
        rows = np.array([low + arm * turn for arm in arms])
        shared = {"normal": rows, "tangential": np.tile(along, (len(arms), 1)), "load": load}
        own = Structure.from_modes(frequency, **shared, **damping)
        found.append(sliding_modes(own, 0.0, 0.05, 5000.0))
    for each in found[1:]:
        np.testing.assert_allclose(each.frequency, found[0].frequency, rtol=1e-7)
        np.testing.assert_allclose(each.growth_rate, found[0].growth_rate, atol=1e-6 * found[0].frequency.max())
