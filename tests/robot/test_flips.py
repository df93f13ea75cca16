"""Flips keep the pose, for whole paths, within the limits; arms without square axes have none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import qparm
from qparm.robot.flips import flips

DOME = qparm.Cell.load("examples/dome.toml").chain()


def test_the_reference_arm_has_shoulder_elbow_and_wrist_and_what_they_make_together():
    found = flips(DOME)
    assert len(found) == 7
    turned = {tuple(np.flatnonzero(flip.sign < 0)) for flip in found}
    assert turned == {(2,), (4,), (6,), (2, 4), (2, 6), (4, 6), (2, 4, 6)}


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_flipped_configuration_has_the_same_pose(seed):
    q = DOME.random(np.random.default_rng(seed), 5)
    for flip in flips(DOME):
        np.testing.assert_allclose(DOME.forward(flip.sign * q + flip.shift), DOME.forward(q), atol=1e-12)


def test_a_path_is_flipped_as_a_whole_or_not_at_all():
    wrist = next(flip for flip in flips(DOME) if (flip.sign < 0).sum() == 1 and flip.sign[6] < 0)
    Q = np.zeros((5, 8))
    Q[:, 5], Q[:, 6], Q[:, 7] = np.linspace(0.5, 1.0, 5), 0.4, np.linspace(-1.0, -0.5, 5)
    flipped = wrist.path(DOME, Q)
    assert flipped is not None
    assert DOME.within_limits(flipped).all()
    np.testing.assert_allclose(np.diff(flipped, axis=0), wrist.sign * np.diff(Q, axis=0), atol=1e-15)
    np.testing.assert_allclose(DOME.forward(flipped), DOME.forward(Q), atol=1e-12)
    Q[:, 5] = np.linspace(-0.3, 0.3, 5)  # half a turn further lies beyond 170 degrees on either side
    assert wrist.path(DOME, Q) is None


@pytest.mark.parametrize("alpha, expected", [("60 deg", 0), ("90 deg", 1)])
def test_axes_that_are_not_square_have_no_flip(alpha, expected):
    def joint(name, alpha, d):
        return {
            "name": name, "type": "revolute", "dh": {"alpha": alpha, "a": "0 mm", "d": d, "theta": "30 deg"},
            "position": ["-180 deg", "180 deg"], "velocity": "1 rad/s", "acceleration": "1 rad/s^2",
            "jerk": "1 rad/s^3",
        }  # fmt: skip

    base = qparm.Cell.load("examples/dome.toml").to_dict()
    base["arm"]["joints"] = [joint("a", "0 deg", "100 mm"), joint("b", alpha, "0 mm"), joint("c", "90 deg", "70 mm")]
    base["arm"]["home"] = ["0 deg"] * 3
    assert len(flips(qparm.Cell.load(base).chain())) == expected
