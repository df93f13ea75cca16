"""Processes against dense linear algebra, the gain against drawing."""

import numpy as np
import pytest

from qparm.design import hypervolume
from qparm.design.archive import free_boxes
from qparm.design.engines.gaussian_process import GaussianProcess, below_zero, fit_censored, fit_values
from qparm.design.engines.improvement import expected_gain, expected_shortfall


def kernel(A, B, theta):
    r = np.sqrt((((A[:, None] - B[None]) / np.exp(theta[:-2])) ** 2).sum(axis=2))
    return np.exp(2 * theta[-2]) * (1 + np.sqrt(5) * r + 5 * r**2 / 3) * np.exp(-np.sqrt(5) * r)


def test_a_process_is_conditioned_as_the_textbook_says():
    rng = np.random.default_rng(0)
    U, C, y, theta = (
        rng.random((12, 3)),
        rng.random((5, 3)),
        rng.standard_normal(12),
        np.array([-0.5, 0.2, 0.0, 0.3, -2]),
    )
    noise = rng.uniform(0, 0.1, 12)
    K = kernel(U, U, theta) + np.diag(noise + np.exp(-4) + 1e-8)
    cross = kernel(U, C, theta)
    prediction = GaussianProcess(U, y, noise, theta).predict(C)
    np.testing.assert_allclose(prediction.mean, cross.T @ np.linalg.solve(K, y), rtol=1e-9)
    variance = np.exp(0.6) - np.einsum("ij,ij->j", cross, np.linalg.solve(K, cross))
    np.testing.assert_allclose(prediction.variance, variance, rtol=1e-9)
    # Expecting a place is conditioning on its mean.
    place = prediction.mean[2]
    prediction.expect(2)
    more = GaussianProcess(np.vstack([U, C[2:3]]), np.append(y, place), np.append(noise, 0.0), theta).predict(C)
    np.testing.assert_allclose(prediction.mean, more.mean, rtol=1e-7)
    np.testing.assert_allclose(prediction.variance, more.variance, rtol=1e-6)


def test_a_fit_finds_what_matters_and_predicts():
    rng = np.random.default_rng(1)
    U, C = rng.random((80, 3)), rng.random((50, 3))

    def f(U):
        return np.sin(5 * U[:, 0]) + 0.5 * np.cos(3 * U[:, 1])

    middle, deviation = f(U).mean(), f(U).std()
    process = fit_values(U, (f(U) - middle) / deviation, iterations=40)
    assert np.argmin(process.theta[:3]) == 0
    assert np.argmax(process.theta[:3]) == 2
    prediction = process.predict(C)
    assert np.sqrt(np.mean((middle + deviation * prediction.mean - f(C)) ** 2)) < 0.02 * deviation


def test_the_border_of_validity_is_found_from_one_side():
    rng = np.random.default_rng(2)
    U, C = rng.random((80, 2)), rng.random((400, 2))
    border = 0.6
    process = fit_censored(U, np.maximum(border - U.sum(axis=1) / 2, 0) / 0.15)
    valid = below_zero(process.predict(C))
    off = C.sum(axis=1) / 2 - border
    assert (valid[off > 0.04] > 0.5).all()
    assert (valid[off < -0.04] < 0.5).all()
    # Deep inside it is not taken for a value of its own: surely negative, wherever exactly.
    assert valid[off > 0.2].min() > 0.9


@pytest.mark.slow
def test_shortfall_and_gain_are_the_mean_over_draws():
    rng = np.random.default_rng(3)
    draws = rng.normal(0.3, 0.5, 400_000)
    shortfall = expected_shortfall(np.array(0.6), np.array(0.3), np.array(0.5))
    assert shortfall == pytest.approx(np.maximum(0.6 - draws, 0).mean(), rel=0.01)
    assert expected_shortfall(np.array(0.6), np.array(0.4), np.array(0.0)) == pytest.approx(0.2)
    for m in (1, 2, 3):
        front, reference = rng.random((4, m)), np.full(m, 1.1)
        mean, deviation = rng.random((3, m)), rng.uniform(0.05, 0.3, (3, m))
        deviation[0, 0] = 0.0
        gain = expected_gain(*free_boxes(front, reference), mean, deviation)
        volume = hypervolume(front, reference)
        for k in range(3):
            F = rng.normal(mean[k], deviation[k], (3000, m))
            drawn = [hypervolume(np.vstack([front, row]), reference) - volume for row in F]
            assert gain[k] == pytest.approx(np.mean(drawn), abs=4 * np.std(drawn) / np.sqrt(3000) + 1e-6)
