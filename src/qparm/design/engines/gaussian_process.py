"""Gaussian processes with Matérn kernels: what is likely where nothing was evaluated (Rasmussen and Williams 2006)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["GaussianProcess", "Prediction", "below_zero", "fit_censored", "fit_values"]

_ROOT5 = np.sqrt(5.0)
# Bounds of logarithms: length scales, deviation, noise.
_SCALES, _DEVIATION, _NOISE = (np.log(0.02), np.log(20.0)), (np.log(0.05), np.log(20.0)), (np.log(1e-4), np.log(1.0))


class GaussianProcess:
    """A process of zero mean on the unit cube, conditioned on values with noise.

    The kernel is Matérn 5/2 with one length scale for each variable.

    Parameters
    ----------
    U : ndarray, shape (n, d)
    y : ndarray, shape (n,)
        Values, scaled to about one.
    noise : ndarray, shape (n,)
        Variances known beforehand, added to the fitted one.
    theta : ndarray, shape (d + 2,)
        Logarithms of length scales, deviation, and deviation of the noise.
    """

    def __init__(
        self, U: NDArray[np.float64], y: NDArray[np.float64], noise: NDArray[np.float64], theta: NDArray[np.float64]
    ) -> None:
        self.U, self.theta = U, theta
        K = self.covariance(U, U)
        K[np.diag_indices(len(U))] += noise + np.exp(2 * theta[-1]) + 1e-8
        self.factor = cholesky(K, lower=True)
        self.weights = cho_solve((self.factor, True), y)

    def covariance(self, A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return prior covariances, (a, b)."""
        scales = np.exp(self.theta[:-2])
        return np.exp(2 * self.theta[-2]) * _matern(_squared(A / scales, B / scales))

    def predict(self, C: NDArray[np.float64]) -> Prediction:
        """Return what is known of places C, (k, d)."""
        cross = self.covariance(self.U, C)
        mean = self.weights @ cross
        half = solve_triangular(self.factor, cross, lower=True, overwrite_b=True)
        variance = np.exp(2 * self.theta[-2]) - np.einsum("ij,ij->j", half, half)
        return Prediction(self, C, mean, np.maximum(variance, 1e-10), half)


class Prediction:
    """Means and variances at places, and how they shrink where some of these will be evaluated.

    Attributes
    ----------
    mean, variance : ndarray, shape (k,)
    """

    def __init__(
        self,
        process: GaussianProcess,
        places: NDArray[np.float64],
        mean: NDArray[np.float64],
        variance: NDArray[np.float64],
        half: NDArray[np.float64],
    ) -> None:
        self.mean, self.variance = mean, variance
        self._process, self._places, self._half = process, places, half

    def expect(self, place: int) -> None:
        """Take one place as evaluated with the value expected there: means stay, variances shrink."""
        prior = self._process.covariance(self._places[place : place + 1], self._places)[0]
        cross = prior - self._half[:, place] @ self._half
        cross /= np.sqrt(max(cross[place], 1e-10) + np.exp(2 * self._process.theta[-1]) + 1e-8)
        self._half = np.vstack([self._half, cross])
        self.variance = np.maximum(self.variance - cross**2, 1e-10)


def _squared(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    squared = (A**2).sum(axis=1)[:, None] + (B**2).sum(axis=1)[None] - 2 * A @ B.T
    return np.maximum(squared, 0.0)


def _matern(squared: NDArray[np.float64]) -> NDArray[np.float64]:
    r = _ROOT5 * np.sqrt(squared)
    return (1 + r + (5.0 / 3.0) * squared) * np.exp(-r)


def _default(d: int) -> NDArray[np.float64]:
    return np.concatenate([np.full(d, np.log(0.4 * np.sqrt(d))), [0.0, np.log(0.03)]])


def _fit(
    U: NDArray[np.float64],
    y: NDArray[np.float64],
    noise: NDArray[np.float64],
    start: NDArray[np.float64] | None,
    iterations: int,
) -> NDArray[np.float64]:
    """Return the parameters of largest likelihood times a broad prior about the default ones."""
    n, d = U.shape
    centre = _default(d)
    spread = np.concatenate([np.full(d, 1.0), [1.0, 1.5]])

    def cost(theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        scales = np.exp(theta[:d])
        V = U / scales
        squared = _squared(V, V)
        r = _ROOT5 * np.sqrt(squared)
        decay = np.exp(2 * theta[d] - r)
        R = (1 + r + (5.0 / 3.0) * squared) * decay
        K = R.copy()
        K[np.diag_indices(n)] += noise + np.exp(2 * theta[-1]) + 1e-8
        try:
            factor = cholesky(K, lower=True, overwrite_a=True)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros_like(theta)
        inverse = cho_solve((factor, True), np.eye(n))
        alpha = inverse @ y
        value = 0.5 * y @ alpha + np.log(np.diag(factor)).sum()
        A = 0.5 * (inverse - np.outer(alpha, alpha))
        gradient = np.empty_like(theta)
        M = A * ((5.0 / 3.0) * (1 + r) * decay)
        gradient[:d] = 2 * (M.sum(axis=1) @ V**2 - np.einsum("ik,ik->k", V, M @ V))
        gradient[d] = 2 * (A * R).sum()
        gradient[-1] = 2 * np.exp(2 * theta[-1]) * np.trace(A)
        off = (theta - centre) / spread
        return float(value + 0.5 * off @ off), gradient + off / spread

    bounds = [_SCALES] * d + [_DEVIATION, _NOISE]
    begin = centre if start is None else start
    found = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations})
    return found.x


def fit_values(
    U: NDArray[np.float64], y: NDArray[np.float64], *, start: NDArray[np.float64] | None = None, iterations: int = 25
) -> GaussianProcess:
    """Return a process fitted to values scaled to zero mean and deviation one."""
    noise = np.zeros(len(U))
    return GaussianProcess(U, y, noise, _fit(U, y, noise, start, iterations))


def fit_censored(
    U: NDArray[np.float64],
    violation: NDArray[np.float64],
    *,
    start: NDArray[np.float64] | None = None,
    iterations: int = 25,
) -> GaussianProcess:
    """Return a process of a quantity that is seen where positive (the violation) and only known to be negative elsewhere.

    A Tobit likelihood in Laplace's approximation: at its mode every valid design counts as a value with a noise of
    its own, which says little of a design far inside.

    Parameters
    ----------
    U : ndarray, shape (n, d)
    violation : ndarray, shape (n,)
        0 where valid; scaled to about one elsewhere.
    """
    valid = violation == 0
    width = 0.05
    y, noise = np.where(valid, -0.5, violation), np.where(valid, 0.25, 0.0)
    theta = _default(U.shape[1]) if start is None else start
    for outer in range(2):
        theta = _fit(U, y, noise, theta, iterations if outer else max(iterations // 2, 5))
        for _ in range(8):
            process = GaussianProcess(U, y, noise, theta)
            f = process.weights @ process.covariance(U, U)
            z = np.clip(-f[valid] / width, -30, 30)
            slope = np.exp(-0.5 * z**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(z))
            curvature = np.maximum(slope * (slope + z), 1e-4)
            target = f[valid] - width * slope / curvature
            moved = np.abs(target - y[valid]).max(initial=0.0)
            y[valid], noise[valid] = target, width**2 / curvature
            if moved < 1e-2:
                break
    return GaussianProcess(U, y, noise, theta)


def below_zero(prediction: Prediction) -> NDArray[np.float64]:
    """Return the probability that a quantity is negative, (k,)."""
    return ndtr(-prediction.mean / np.sqrt(prediction.variance))
