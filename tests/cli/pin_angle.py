"""A study that builds its structures with scikit-fem: a pin that leans on a moving surface."""

import numpy as np
from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, MeshQuad
from skfem.helpers import ddot, dot, eye, sym_grad, trace

import studies
from fivcore import Scene, Structure, simulate
from studies.study import Parameter, Study

WIDTH, LENGTH, E, NU, RHO = 2e-3, 0.1, 200e9, 0.3, 7800.0  # square steel pin: m, Pa, kg/m3


@BilinearForm
def stiffness(u, v, _):
    strain = sym_grad(u)
    stress = E / (1.0 - NU**2) * ((1.0 - NU) * strain + NU * eye(trace(strain), 2))
    return WIDTH * ddot(stress, sym_grad(v))


@BilinearForm
def mass(u, v, _):
    return WIDTH * RHO * dot(u, v)


def pin(angle):
    """The upper quarter slides along the pin's axis, pushed by the load; the foot is on a surface `angle` off."""
    mesh = MeshQuad.init_tensor(np.linspace(0.0, WIDTH, 3), np.linspace(0.0, LENGTH, 13))
    basis = Basis(mesh, ElementVector(ElementQuad2()))
    free = basis.complement_dofs(basis.get_dofs(elements=lambda x: x[1] > 0.75 * LENGTH).all("u^1"))
    middle = mesh.nodes_satisfying(lambda x: x[0] == WIDTH / 2)
    foot, head = (basis.nodal_dofs[:, k] for k in middle[np.argsort(mesh.p[1, middle])][[0, -1]])
    rows = dict(zip(("normal", "tangential", "load"), np.zeros((3, basis.N)), strict=True))
    rows["normal"][foot] = np.sin(angle), np.cos(angle)
    rows["tangential"][foot] = np.cos(angle), -np.sin(angle)
    rows["load"][head] = 0.0, -1.0
    M, K = (form.assemble(basis)[free][:, free] for form in (mass, stiffness))
    return Structure.from_matrices(
        M, K, **{k: row[free] for k, row in rows.items()}, damping_ratio=0.005, fmax=50e3
    )


def vibrations(angle, mu):
    pins = [pin(np.radians(each)) for each in angle]
    runs = [simulate(Scene(0.1, 0.0, mu, 10.0, each), 0.2) for each in pins]
    return {
        "bending_frequency": [each.frequency[1] for each in pins],
        "velocity_rms": [run.summary["velocity_rms"] for run in runs],
    }


STUDY = Study(
    name="pin_angle",
    title="Pin on a moving surface",
    question="Towards which side must a pin lean to be quiet?",
    parameters={"angle": Parameter([-15.0, 0.0, 15.0], "degree"), "mu": Parameter(0.4)},
    outputs={"bending_frequency": ("Hz", "first bending mode"), "velocity_rms": ("m s-1", "velocity of the foot")},
    function=vibrations,
)

if __name__ == "__main__":
    print(studies.run(STUDY)["velocity_rms"])
