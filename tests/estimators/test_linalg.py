"""The 6 by 6 kernels against numpy."""

import numpy as np
import pytest

from estimators import linalg as la


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def spd(rng: np.random.Generator, spread: float = 1e3) -> np.ndarray:
    """A symmetric positive definite matrix with the given condition number."""
    V, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    P = (V * np.geomspace(1, spread, 6)) @ V.T
    return 0.5 * (P + P.T)


def test_products(rng: np.random.Generator) -> None:
    A, B, P, d = rng.normal(size=(6, 6)), rng.normal(size=(6, 6)), spd(rng), rng.uniform(size=6)
    C, AP, v = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    la.matmul(A, B, C)
    assert np.allclose(C, A @ B, rtol=0, atol=1e-14)
    la.matvec(A, d, v)
    assert np.allclose(v, A @ d, rtol=0, atol=1e-14)
    la.gram(A, C)
    assert np.allclose(C, A.T @ A, rtol=0, atol=1e-14)
    la.congruence(A, P, AP, C)
    assert np.allclose(C, A @ P @ A.T, rtol=1e-12)
    assert np.array_equal(C, C.T)
    la.add_congruence_diagonal(A, d, C)
    assert np.allclose(C, A @ P @ A.T + (A * d) @ A.T, rtol=1e-12)
    assert np.array_equal(C, C.T)
    la.congruence(A, P, AP, P)
    assert np.allclose(AP @ A.T, P, rtol=1e-12)


def test_cholesky_solves(rng: np.random.Generator) -> None:
    M, B, b = spd(rng), rng.normal(size=(6, 6)), rng.normal(size=6)
    L = np.zeros((6, 6))
    assert la.cholesky(M, L)
    Lo = np.linalg.cholesky(M)
    X, x = B.copy(), b.copy()
    la.forward(L, X)
    la.forward_vector(L, x)
    Y = X.copy()
    la.backward(L, Y)
    assert np.allclose(Lo @ X, B, atol=1e-12)
    assert np.allclose(Lo @ x, b, atol=1e-12)
    assert np.allclose(M @ Y, B, atol=1e-11)


def test_cholesky_refuses_what_is_not_positive_definite(rng: np.random.Generator) -> None:
    M = spd(rng)
    for bad in (M - 2 * np.eye(6), np.zeros((6, 6)), M * np.nan):
        assert not la.cholesky(bad, np.zeros((6, 6)))


def test_inverse_pivots_and_reports_singularity(rng: np.random.Generator) -> None:
    for _ in range(20):
        A = rng.normal(size=(6, 6))
        A[rng.integers(6), rng.integers(6)] = 0.0
        A[0, 0] = 0.0
        inverse = A.copy()
        assert la.invert(inverse)
        assert np.allclose(inverse @ A, np.eye(6), atol=1e-10)
    permuted = np.eye(6)[[3, 0, 5, 1, 4, 2]]
    inverse = permuted.copy()
    assert la.invert(inverse)
    assert np.array_equal(inverse, permuted.T)
    A[3] = 0.0
    assert not la.invert(A)
    assert not la.invert(np.full((6, 6), np.nan))
