"""Conventions of other programs against those programs themselves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.exact.polynomial import Polynomial
from echelon.robot.inertia import (
    CONVENTIONS,
    about_centre,
    convention,
    frame_change,
    from_pseudo_inertia,
    from_spatial_inertia,
    move,
    pseudo_inertia,
    spatial_inertia,
    with_zeros,
)

Floats = npt.NDArray[np.float64]


def bodies(seed: int, count: int = 5) -> Floats:
    """Standard parameters of random bodies made of point masses, so that they are physical."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 6, 3)) + rng.uniform(-1, 1, (count, 1, 3))
    masses = rng.uniform(0.1, 2, (count, 6))
    extended = np.concatenate([points, np.ones((count, 6, 1))], axis=-1)
    return from_pseudo_inertia(np.einsum("bk,bki,bkj->bij", masses, extended, extended))


def random_frame(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    homogeneous = np.eye(4)
    homogeneous[:3, :3] = rotation * np.linalg.det(rotation)
    homogeneous[:3, 3] = rng.uniform(-1, 1, 3)
    return homogeneous


@pytest.mark.parametrize("name", CONVENTIONS)
@given(seed=st.integers(0, 10_000))
def test_there_and_back(name: str, seed: int) -> None:
    values = bodies(seed)
    other = ec.convert(values, "echelon", name)
    assert other.shape == (5, *convention(name).shape)
    np.testing.assert_allclose(ec.convert(other, name, "echelon"), values, atol=1e-9)
    np.testing.assert_allclose(
        ec.convert(other[2], name, "echelon"), values[2], atol=1e-9
    )


def test_pinocchio() -> None:
    import pinocchio as pin

    for values in bodies(1):
        inertia = pin.Inertia.FromDynamicParameters(
            ec.convert(values, "echelon", "pinocchio")
        )
        np.testing.assert_allclose(
            inertia.toDynamicParameters(),
            ec.convert(values, "echelon", "pinocchio"),
            atol=1e-9,
        )
        urdf = ec.convert(values, "echelon", "urdf")
        assert inertia.mass == pytest.approx(urdf[0])
        np.testing.assert_allclose(inertia.lever, urdf[1:4], atol=1e-9)
        np.testing.assert_allclose(
            inertia.inertia[np.triu_indices(3)], urdf[4:], atol=1e-9
        )
        swap = [3, 4, 5, 0, 1, 2]  # Pinocchio has the linear part first
        np.testing.assert_allclose(
            inertia.matrix()[np.ix_(swap, swap)], spatial_inertia(values), atol=1e-9
        )


def test_frame_change_is_pinocchios_action() -> None:
    import pinocchio as pin

    for seed, values in enumerate(bodies(2)):
        frame = random_frame(seed)
        placement = pin.SE3(frame[:3, :3], frame[:3, 3])
        moved = placement.act(
            pin.Inertia.FromDynamicParameters(
                ec.convert(values, "echelon", "pinocchio")
            )
        )
        expected = ec.convert(moved.toDynamicParameters(), "pinocchio", "echelon")
        np.testing.assert_allclose(move(values, frame), expected, atol=1e-9)
        np.testing.assert_allclose(frame_change(frame) @ values, expected, atol=1e-9)


def test_pinocchios_regressor_predicts_the_same_torques() -> None:
    import pinocchio as pin

    model = pin.buildSampleModelManipulator()
    rng = np.random.default_rng(3)
    q, v, a = (rng.uniform(-1, 1, model.nv) for _ in range(3))
    theirs = pin.computeJointTorqueRegressor(model, model.createData(), q, v, a)
    ours = ec.convert_columns(theirs, "pinocchio", "echelon")
    stacked = np.concatenate(
        [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]
    )
    values = ec.convert(stacked.reshape(-1, 10), "pinocchio", "echelon").ravel()
    np.testing.assert_allclose(
        ours @ values, pin.rnea(model, model.createData(), q, v, a), atol=1e-9
    )
    np.testing.assert_allclose(ec.convert_columns(ours, "echelon", "pinocchio"), theirs)


def test_idyntree() -> None:
    import idyntree.bindings as idyntree

    for values in bodies(4):
        inertia = idyntree.SpatialInertia()
        inertia.fromVector(
            idyntree.Vector10(ec.convert(values, "echelon", "idyntree").tolist())
        )
        urdf = ec.convert(values, "echelon", "urdf")
        assert inertia.getMass() == pytest.approx(urdf[0])
        np.testing.assert_allclose(
            inertia.getCenterOfMass().toNumPy(), urdf[1:4], atol=1e-9
        )
        np.testing.assert_allclose(
            inertia.asVector().toNumPy(),
            ec.convert(urdf, "urdf", "idyntree"),
            atol=1e-9,
        )


def test_mujoco_compiles_the_same_principal_axes() -> None:
    import mujoco

    values = bodies(5)
    full = ec.convert(values, "echelon", "mujoco_full")
    text = "".join(
        f"<body><freejoint/><inertial mass='{b[0]}' pos='{b[1]} {b[2]} {b[3]}' "
        f"fullinertia='{' '.join(map(str, b[4:]))}'/>"
        "<geom size='0.1' mass='0'/></body>"
        for b in full
    )
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{text}</worldbody></mujoco>"
    )
    compiled = np.hstack(
        [
            model.body_mass[1:, None],
            model.body_ipos[1:],
            model.body_iquat[1:],
            model.body_inertia[1:],
        ]
    )
    np.testing.assert_allclose(
        ec.convert(compiled, "mujoco", "echelon"), values, atol=1e-7
    )
    ours = ec.convert(values, "echelon", "mujoco")
    np.testing.assert_allclose(
        ours[:, [0, 1, 2, 3, 8, 9, 10]], compiled[:, [0, 1, 2, 3, 8, 9, 10]], atol=1e-7
    )


def test_matlab_and_spatial_v2_by_their_documented_formulas() -> None:
    """rigidBody.Inertia is [Ixx Iyy Izz Iyz Ixz Ixy] about the body frame; mcI(m, c, I) moves I from the centre."""
    values = bodies(6)[0]
    matlab = ec.convert(values, "echelon", "matlab")
    np.testing.assert_allclose(matlab[4:], values[[0, 3, 5, 4, 2, 1]])
    mass, centre = matlab[0], matlab[1:4]
    np.testing.assert_allclose(centre * mass, values[6:9])
    urdf = ec.convert(values, "echelon", "urdf")
    tensor = np.zeros((3, 3))
    tensor[np.triu_indices(3)] = urdf[4:]
    tensor = np.triu(tensor) + np.triu(tensor, 1).T
    c = np.array(
        [
            [0, -centre[2], centre[1]],
            [centre[2], 0, -centre[0]],
            [-centre[1], centre[0], 0],
        ]
    )
    mci = np.block(
        [[tensor + mass * c @ c.T, mass * c], [mass * c.T, mass * np.eye(3)]]
    )
    np.testing.assert_allclose(
        ec.convert(values, "echelon", "spatial_v2"), mci, atol=1e-12
    )
    np.testing.assert_allclose(from_spatial_inertia(mci), values, atol=1e-12)


def test_frames_and_exact_numbers() -> None:
    values = bodies(7)
    first, second = random_frame(1), random_frame(2)
    np.testing.assert_allclose(
        move(move(values, second), first), move(values, first @ second), atol=1e-9
    )
    length = Polynomial.generator("a")
    shift = np.array(
        [[1, 0, 0, length], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=object
    )
    exact = frame_change(shift)
    mass = list(exact[:, 9])  # a point mass at distance a along x
    assert mass == [0, 0, 0, length * length, 0, length * length, length, 0, 0, 1]


def test_pseudo_inertia_of_a_physical_body_is_positive() -> None:
    assert np.linalg.eigvalsh(pseudo_inertia(bodies(8))).min() > 0


def test_what_cannot_be_converted() -> None:
    values = bodies(9, 2)
    values[1, 9] = 0.0
    with pytest.raises(
        ec.InputError, match=r"body 1: its mass is 0 kg; mujoco states a centre of mass"
    ):
        ec.convert(values, "echelon", "mujoco")
    with pytest.raises(ec.InputError, match="body 1: its mass"):
        ec.convert(values, "echelon", "urdf")
    assert ec.convert(values, "echelon", "idyntree").shape == (2, 10)
    with pytest.raises(
        ec.InputError, match=r"unknown convention 'drake' \(valid: echelon, pinocchio"
    ):
        ec.convert(values, "echelon", "drake")
    with pytest.raises(ec.InputError, match="per body, got an array of shape"):
        ec.convert(values[:, :9], "echelon", "pinocchio")
    with pytest.raises(
        ec.InputError,
        match=r"no regressor has columns in the convention 'urdf' \(valid: echelon, pino",
    ):
        ec.convert_columns(np.zeros((3, 20)), "echelon", "urdf")
    with pytest.raises(ec.InputError, match="expected 10 columns per body"):
        ec.convert_columns(np.zeros((3, 21)), "echelon", "pinocchio")


# -- zeros -------------------------------------------------------------------------------------------------------------

PRODUCTS = {1: (0, 1), 2: (0, 2), 4: (1, 2), 6: (0, 3), 7: (1, 3), 8: (2, 3)}


@given(
    seed=st.integers(0, 10_000),
    place=st.sampled_from(list(PRODUCTS)),
    mass=st.floats(-9, 9),
    length=st.floats(-4, 4),
)
def test_zeros_are_small_against_the_body(
    seed: int, place: int, mass: float, length: float
) -> None:
    """Units of mass and length do not matter: a share of 1e-11 counts as zero, one of 1e-7 does not."""
    scale = np.diag([10**length] * 3 + [1.0])
    body = from_pseudo_inertia(
        10**mass * scale @ pseudo_inertia(bodies(seed, 1)[0]) @ scale
    )
    i, j = PRODUCTS[place]
    diagonal = np.diag(pseudo_inertia(body))
    body[place] = 1e-11 * np.sqrt(diagonal[i] * diagonal[j])
    assert with_zeros(body)[place] == 0
    body[place] *= 1e4
    assert with_zeros(body)[place] == body[place]


@given(seed=st.integers(0, 10_000))
def test_axes_of_symmetry_leave_no_products_about_the_centre(seed: int) -> None:
    """Parallel axes leave differences of equal products there, which are zero but for rounding."""
    rng = np.random.default_rng(seed)
    stated = np.array([rng.uniform(0.1, 9), *rng.uniform(-1, 1, 3), *[0.0] * 6])
    stated[[4, 7, 9]] = rng.uniform(0.02, 0.03, 3)
    mass, centre, moments = about_centre(ec.convert(stated, "urdf", "echelon"))
    np.testing.assert_array_equal(moments[[1, 2, 4]], 0.0)
    np.testing.assert_allclose([mass, *centre, *moments], stated, rtol=1e-9)


def test_no_moment_and_no_mass_becomes_zero() -> None:
    """Files of thin or light bodies are refused by simulators if a moment of theirs is zero."""
    thin = np.array([1e-20, 0, 0, 1.0, 0, 1.0, 0, 0, 0, 1e-20])
    np.testing.assert_array_equal(with_zeros(thin), thin)
    assert not with_zeros(np.zeros(10)).any()
