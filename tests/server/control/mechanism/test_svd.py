import numpy as np
import pytest
from telerobot.server.control.linalg import svd

SHAPES = [(6, 7), (6, 6), (6, 12), (6, 24), (6, 4), (1, 1), (3, 1)]


def check(A, U, s, Vt, atol=1e-13):
    """What makes it a singular value decomposition of A, to rounding beside its size."""
    m, n = A.shape
    r, whole = min(m, n), max(np.linalg.norm(A), 1e-300)
    np.testing.assert_allclose(U @ U.T, np.eye(m), atol=atol)
    np.testing.assert_allclose(Vt @ Vt.T, np.eye(n), atol=atol)
    np.testing.assert_allclose(U[:, :r] * s @ Vt[:r] / whole, A / whole, atol=atol)
    assert (np.diff(s) <= 0.0).all()
    assert (s >= 0.0).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_the_decomposition_that_lapack_finds(shape, rng):
    for _ in range(20):
        A = rng.normal(size=shape)
        U, s, Vt = svd(A)
        check(A, U, s, Vt)
        np.testing.assert_allclose(s, np.linalg.svd(A, compute_uv=False), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("least", [1e-3, 1e-8, 1e-12, 1e-15, 1e-18, 0.0])
@pytest.mark.parametrize("shape", [(6, 7), (6, 6)])
def test_singular_and_nearly_singular_matrices_have_orthogonal_bases_too(least, shape, rng):
    m, n = shape
    for fading in (1, 2, 5):
        U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (m, n))
        s = np.array([*np.linspace(2.0, 1.0, m - fading), *[least] * fading])
        A = U[:, :m] * s @ V[:m]
        found = svd(A)
        check(A, *found)
        np.testing.assert_allclose(found[1], s, rtol=1e-12, atol=5e-15)


def test_rows_of_very_different_size_keep_their_digits():
    """LAPACK's, by bidiagonals, loses them: what is small is known to 1e-16 of the largest only."""
    orthogonal = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]) / np.sqrt(
        [[2], [2], [1]]
    )
    A = np.array([1e-12, 1.0, 1e-6])[:, None] * orthogonal
    np.testing.assert_allclose(svd(A)[1], [1.0, 1e-6, 1e-12], rtol=1e-14)


@pytest.mark.parametrize("A", [np.zeros((6, 7)), np.eye(6), np.ones((6, 7)), 1e-100 * np.eye(3)])
def test_plain_matrices(A):
    check(A, *svd(A))


def test_a_matrix_with_what_is_not_a_number_ends_too():
    assert np.isnan(svd(np.full((6, 7), np.nan))[1]).any()
