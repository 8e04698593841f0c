"""From registrations to edges, and the builder's snapshots."""

import numpy as np
import pytest

from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind, HeadingObservation, PositionObservation, ScaleObservation
from photomap_gis.core.similarity import Similarity2D, fit_similarity
from photomap_gis.slam import GraphBuilder
from photomap_gis.slam.build import Gate, edge_of, model_covariance

T = Similarity2D(60.0, -20.0, 0.05, 0.01)
COVARIANCE = np.diag([0.01, 0.02, 1e-6, 1e-6])
CENTRE = Similarity2D.translation_of(127.5, 95.5)
# planes at three times the working image's resolution, origin at its centre
WORK = Similarity2D(0.0, 0.0, 0.0, np.log(3.0)) @ CENTRE.inverse()


def registration(**known) -> Registration:
    values = {"probability": 0.95, "size_b_px": (256, 192), "accepted": True, "overlap": 0.7, "a": 3, "b": 8}
    return Registration(T, COVARIANCE, **(values | known))


def test_an_edge_lives_in_the_planes():
    edge = edge_of(registration(), WORK, WORK, EdgeKind.LOOP)
    points = np.array([[0.0, 0.0], [255.0, 191.0], [10.0, 80.0]])
    np.testing.assert_allclose(edge.T_a_b.apply(WORK.apply(points)), WORK.apply(T.apply(points)), atol=1e-9)
    # about the plane's origin, which is the image's centre: three times the pixels, the same angle
    np.testing.assert_allclose(np.sqrt(np.diagonal(edge.covariance)), np.sqrt([0.09, 0.18, 1e-6, 1e-6]), rtol=0.03)
    assert (edge.a, edge.b, edge.kind, edge.probability, edge.overlap) == (3, 8, EdgeKind.LOOP, 0.95, 0.7)


def test_misfit_widens_all_four_degrees_of_freedom():
    plain, bent = (edge_of(registration(model_sigma_px=m), WORK, WORK, EdgeKind.LOOP) for m in (0.0, 2.0))
    assert (np.diagonal(bent.covariance) > 10 * np.diagonal(plain.covariance)).all()
    assert np.linalg.eigvalsh(bent.covariance).min() > 0


def test_misfit_is_what_a_slow_warp_does_to_a_fit(rng):
    """Bend the overlap by random low-order warps of known RMS: the fit at the image centre scatters as claimed."""
    m, samples, offs = 1.5, [], []
    x, y = np.meshgrid(np.linspace(0, 255, 17), np.linspace(0, 191, 13))
    b = np.stack([x.ravel(), y.ravel()], axis=1)
    a = T.apply(b)
    b = b[((a >= 0) & (a <= (255, 191))).all(axis=1)]
    u = (b - b.mean(axis=0)) / b.std(axis=0)
    basis = np.stack([np.ones(len(b)), u[:, 0], u[:, 1], u[:, 0] * u[:, 1], u[:, 0] ** 2, u[:, 1] ** 2], axis=1)
    for _ in range(600):
        warp = np.stack([basis @ rng.normal(size=6), basis @ rng.normal(size=6)], axis=1)
        warp *= m / np.sqrt(np.mean(warp**2))
        fit = fit_similarity(T.apply(b) + warp, b)
        offs.append((CENTRE.inverse() @ T.inverse() @ fit @ CENTRE).log())
        samples.append(warp)
    scatter = np.sqrt(np.mean(np.square(offs), axis=0))
    claimed = np.sqrt(np.diagonal(model_covariance(registration(model_sigma_px=m))))
    assert (scatter < 1.5 * claimed).all() and (scatter > claimed / 3.0).all()


def test_a_misfit_without_overlap_is_still_finite():
    reg = registration(model_sigma_px=1.0)
    far = Registration(Similarity2D(9000.0, 0.0), COVARIANCE, 0.9, (256, 192), 1.0, True, a=0, b=1)
    assert np.isfinite(model_covariance(far)).all() and np.isfinite(model_covariance(reg)).all()


@pytest.mark.parametrize(
    ("known", "passes"),
    [({}, True), ({"accepted": False}, False), ({"probability": 0.2}, False)],
)
def test_the_gate(known, passes):
    builder = GraphBuilder()
    assert builder.add_registration(registration(**known), WORK, WORK, EdgeKind.SEQUENTIAL) is passes
    assert len(builder.snapshot().edges) == passes


def test_absurd_scales_do_not_pass():
    reg = Registration(Similarity2D(0, 0, 0, 2.0), COVARIANCE, 0.99, (256, 192), accepted=True, a=0, b=1)
    assert not GraphBuilder().add_registration(reg, WORK, WORK, EdgeKind.LOOP)
    assert GraphBuilder(Gate(max_scale_ratio=10.0)).add_registration(reg, WORK, WORK, EdgeKind.LOOP)


def test_a_nameless_registration_is_a_mistake():
    with pytest.raises(ValueError, match="two frames"):
        GraphBuilder().add_registration(registration(a=-1), WORK, WORK)


def test_of_two_measurements_of_a_pair_the_surer_stays():
    builder = GraphBuilder()
    builder.add_registration(registration(method="sure"), WORK, WORK)
    builder.add_registration(registration(method="vague", model_sigma_px=3.0), WORK, WORK)
    (edge,) = builder.snapshot().edges
    assert edge.method == "sure" and builder.pairs == {(3, 8)}


def test_snapshots_are_frozen_and_counted():
    builder = GraphBuilder()
    builder.add_frame(5)
    first = builder.snapshot()
    builder.observe([PositionObservation(9, np.zeros(2), np.eye(2))], [ScaleObservation(2, 0.1, 0.1)])
    builder.observe(headings=[HeadingObservation(9, 0.1, 0.1)])
    second = builder.snapshot()
    assert (first.frames, first.revision) == ((5,), 1)
    assert (second.frames, second.revision) == ((2, 5, 9), 2)
    assert second.georeferenced and not first.georeferenced
