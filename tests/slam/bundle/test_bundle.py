"""The full solution finds cameras, lens and ground again in worlds of known truth."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import dense_of, make_world

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import PosedPlacement
from photomap_gis.core.posegraph import PositionObservation
from photomap_gis.core.similarity import fit_similarity
from photomap_gis.slam.bundle import Lens, Marks, bundle_adjust
from photomap_gis.slam.bundle.equations import SpotPrior, prior_cost, reduced_equations, spots_settled
from photomap_gis.slam.bundle.fixes import FixNoise, fix_noise
from photomap_gis.slam.bundle.ground import fit_ground
from photomap_gis.slam.bundle.layout import Layout
from photomap_gis.slam.bundle.marks import mark_terms
from photomap_gis.slam.bundle.model import cameras_of, linearise
from photomap_gis.slam.bundle.problem import BundleState, exp_rotation, log_rotation

GSD = 100.0 / 1200.0


def map_errors(world, bundle) -> np.ndarray:
    """Errors in pixels on the ground of what frames show, after the best similarity."""
    rng = np.random.default_rng(9)
    true, found = [], []
    for k in range(len(world.centre)):
        xy = rng.uniform((100, 100), (1500, 1100), (25, 2))
        c, t = world.centre[k], bundle.centre[k]
        true.append(PosedPlacement(world.camera, c * (1, 1, -1), world.R[k], world.ground).project(xy))
        camera = bundle.lenses[0].camera
        found.append(PosedPlacement(camera, t * (1, 1, -1), bundle.R_map_camera[k], bundle.ground).project(xy))
    true, found = np.concatenate(true), np.concatenate(found)
    return np.hypot(*(found - fit_similarity(found, true).apply(true)).T) / GSD


def test_derivatives_are_those_of_differences(rng):
    world = make_world(rng, strips=1, a_strip=3, relief=3.0, camera=Camera(1600, 1200, 1200.0, k1=-0.06, k2=0.01))
    p = world.problem
    state = replace(BundleState.start(p), z=rng.normal(0, 2, p.ties.spots))
    found, h = linearise(p, state), 1e-6
    size, m = 6 * len(p.views) + 2, np.arange(len(p.ties))
    whole = np.zeros((len(m), 2, size))
    for k in range(6):
        whole[m, :, 6 * p.ties.a + k] += found.by_a[:, :, k]
        whole[m, :, 6 * p.ties.b + k] += found.by_b[:, :, k]
    whole[:, :, -2:] = found.by_lens_a + found.by_lens_b
    still = np.zeros(p.ties.spots)
    for k in range(size):
        step = np.zeros(size)
        step[k] = h
        ahead, behind = (linearise(p, state.moved(s * step, still)).residual for s in (1, -1))
        assert whole[:, :, k] == pytest.approx((ahead - behind) / (2 * h), rel=1e-5, abs=1e-3)
    up, down = (linearise(p, state.moved(np.zeros(size), still + s * h)).residual for s in (1, -1))
    assert found.by_z == pytest.approx((up - down) / (2 * h), rel=1e-5, abs=1e-4)


def surface_of(rng, p, bends: int) -> SpotPrior:
    P = p.ties.spots
    return SpotPrior(
        rng.normal(0, 1, P), rng.uniform(0.1, 0.3, P), rng.normal(0, 1, (P, bends)), rng.uniform(0.5, 1.0, bends),
        np.zeros(P, np.intp), np.log([v.focal_px for v in p.lenses]) + 0.01,
    )  # fmt: skip


def test_reduced_equations_are_the_whole_ones_with_the_spots_taken_out(rng):
    """The twin: one dense system of all unknowns, without any elimination."""
    world = make_world(rng, strips=1, a_strip=4, relief=2.0, spots=3)
    p = world.problem
    n, P, bends = len(p.views), p.ties.spots, 3
    state = replace(BundleState.start(p), z=rng.normal(0, 2, P))
    found = linearise(p, state)
    W = np.linalg.inv(p.ties.covariance)
    prior = surface_of(rng, p, bends)
    free = np.ones((1, 2), bool)
    layout = Layout.of(p, bends)
    reduced = reduced_equations(layout, p, state, found, W, prior, free)
    step = reduced.normal.step()
    size = 6 * n + 2 + bends
    nothing = replace(found, valid=np.zeros(len(p.ties), bool))
    bare = reduced_equations(layout, p, state, nothing, W, replace(prior, information=np.full(P, 1e-30)), free)
    H, g = np.zeros((size + P, size + P)), np.zeros(size + P)
    H[:size, :size], g[:size] = dense_of(p, bare)
    for k in range(P):
        unit = np.exp(prior.log_focal[0] - state.log_focal[0])
        J = np.zeros(size + P)
        J[size + k], J[6 * n], J[6 * n + 2 : size] = unit, -unit * state.z[k], -prior.bends[k]
        H += prior.information[k] * np.outer(J, J)
        g += prior.information[k] * J * (unit * state.z[k] - prior.z[k])
    for k in range(len(p.ties)):
        J = np.zeros((2, size + P))
        J[:, 6 * p.ties.a[k] : 6 * p.ties.a[k] + 6] = found.by_a[k]
        J[:, 6 * p.ties.b[k] : 6 * p.ties.b[k] + 6] = found.by_b[k]
        J[:, 6 * n : 6 * n + 2] = found.by_lens_a[k] + found.by_lens_b[k]
        J[:, size + p.ties.spot[k]] = found.by_z[k]
        H += J.T @ W[k] @ J
        g += J.T @ W[k] @ found.residual[k]
    whole = np.linalg.solve(H, -g)
    assert step == pytest.approx(whole[:size], rel=1e-5, abs=1e-8)
    assert reduced.spots_for(p, step) == pytest.approx(whole[size:], rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("bends", [0, 3])
def test_the_equations_go_down_the_cost_that_is_counted(rng, bends):
    """With spots and surface where they want to be, the reduced gradient is that of the cost."""
    world = make_world(rng, strips=1, a_strip=4, relief=2.0, spots=3)
    p, prior, free = world.problem, surface_of(rng, world.problem, bends), np.ones((1, 2), bool)
    W = np.linalg.inv(p.ties.covariance)

    def settled(state):
        for _ in range(8):
            state = spots_settled(p, state, W, prior)
        return state

    def cost(state):
        r = linearise(p, state).residual
        return float(np.einsum("mi,mij,mj->", r, W, r)) + prior_cost(p, state, prior)

    size, still = 6 * len(p.views) + 2, np.zeros(p.ties.spots)
    state = settled(BundleState.start(p))
    H, g = dense_of(p, reduced_equations(Layout.of(p, bends), p, state, linearise(p, state), W, prior, free))
    inner = np.linalg.solve(H[size:, size:], g[size:])
    gradient = 2.0 * (g[:size] - H[:size, size:] @ inner)
    for k in (0, 2, 4, 11, size - 2, size - 1):
        step = np.zeros(size + bends)
        step[k] = h = 1e-5
        ahead, behind = (cost(settled(state.moved(s * step, still))) for s in (1, -1))
        assert gradient[k] == pytest.approx((ahead - behind) / (2 * h), rel=1e-3, abs=1e-2 * np.abs(gradient).max())


def test_the_surface_does_not_favour_a_shorter_lens(rng):
    """Under a shorter lens the same parallax is a lower relief: as likely as the higher one under the longer."""
    p = make_world(rng, strips=1, a_strip=4, spots=3).problem
    prior = surface_of(rng, p, 0)
    long = replace(BundleState.start(p), z=rng.normal(0, 2, p.ties.spots))
    short = replace(long, log_focal=long.log_focal - 0.1, z=long.z * np.exp(-0.1))
    assert prior.off(short)[0] == pytest.approx(prior.off(long)[0])


@pytest.mark.parametrize("relief", [0.0, 4.0])
def test_cameras_that_lean_unknown_ways_are_found(rng, relief):
    world = make_world(rng, relief=relief)
    bundle = bundle_adjust(world.problem)
    assert bundle.rms_px < 0.5 < bundle.rms_before_px
    assert np.sqrt(np.mean(map_errors(world, bundle) ** 2)) < (0.5 if relief == 0.0 else 2.0)


def test_a_common_lean_of_fifteen_degrees_and_an_unknown_lens(rng):
    camera = Camera(1600, 1200, 1200.0, k1=-0.04)
    told = replace(camera, focal_px=1225.0, k1=0.0)
    world = make_world(rng, camera=camera, told=told, lean=(0.26, 0.0), lens=Lens(told, 0.03, 0.05), strips=4)
    leaning = [replace(v, R_map_camera=v.R_map_camera @ exp_rotation(np.array([[0.22, 0, 0]]))[0],
                       tilt_sigma_rad=0.3) for v in world.problem.views]  # fmt: skip
    bundle = bundle_adjust(replace(world.problem, views=tuple(leaning)))
    lens = bundle.lenses[0]
    assert lens.focal_observed and lens.k1_observed
    assert abs(lens.camera.focal_px / 1200.0 - 1.0) < max(0.005, 3.0 * lens.focal_sigma_log)
    assert lens.camera.k1 == pytest.approx(-0.04, abs=3.0 * lens.k1_sigma + 0.002)
    assert np.sqrt(np.mean(map_errors(world, bundle) ** 2)) < 3.0


def test_over_flat_ground_the_focal_length_of_nadir_frames_cannot_be_told(rng):
    world = make_world(rng, tilt=0.005, lens=Lens(Camera(1600, 1200, 1200.0), 0.01, 0.02))
    lens = bundle_adjust(world.problem).lenses[0]
    assert not lens.focal_observed
    assert lens.camera.focal_px == pytest.approx(1200.0, rel=1e-9), "what cannot be told stays as it was"


def test_what_chance_explains_is_not_taken_and_stays_part_of_the_sigmas():
    """A right lens is left as it is; that it could be off a little is not forgotten."""
    held = 0
    for seed in range(4):
        world = make_world(np.random.default_rng(seed), strips=4)
        found = bundle_adjust(world.problem)
        lens = found.lenses[0]
        assert lens.k1_observed and 0.0 < lens.k1_sigma < 0.015
        held += lens.camera.k1 == 0.0
    assert held >= 3, "four sigmas of two"


def test_false_ties_do_not_bend_the_map(rng):
    clean = make_world(np.random.default_rng(3))
    spoilt = make_world(np.random.default_rng(3), false_share=0.15)
    errors = [np.sqrt(np.mean(map_errors(w, bundle_adjust(w.problem)) ** 2)) for w in (clean, spoilt)]
    assert errors[1] < 1.5 * errors[0] + 0.1
    assert bundle_adjust(spoilt.problem).kept < 0.95


def test_predicted_sigmas_are_those_of_the_errors():
    """NEES of centres and turns over several worlds, GPS and all."""
    nees = []
    for seed in range(10):
        world = make_world(np.random.default_rng(100 + seed), strips=2, a_strip=5)
        bundle = bundle_adjust(world.problem)
        for k in range(len(world.centre)):
            off = world.centre[k] - bundle.centre[k]
            turn = log_rotation((world.R[k] @ bundle.R_map_camera[k].T)[None])[0]
            # heights begin anywhere: the ground's level takes them
            e = np.r_[off[:2], turn]
            keep = [0, 1, 3, 4, 5]
            nees.append(e @ np.linalg.solve(bundle.covariance[k][np.ix_(keep, keep)], e) / 5.0)
    assert 0.3 < np.mean(nees) < 1.6


def marks_of(world, rng, views=(0, 5, 12, 17), sigma=0.05, shared=0.0):
    """One known point in the middle of each of some frames; ``shared`` is the sigma of an error of all of them."""
    px = rng.uniform((500, 400), (1100, 800), (len(views), 2))
    where = [
        PosedPlacement(world.camera, world.centre[v] * (1, 1, -1), world.R[v], world.ground).project(p[None])[0]
        for v, p in zip(views, px, strict=True)
    ]
    own = np.tile(sigma**2 * np.eye(2), (len(views), 1, 1))
    group, places = (0, [shared**2 * np.eye(2)]) if shared else (-1, np.zeros((0, 2, 2)))
    return Marks(np.array(views), px, np.array(where), own, np.full(len(views), group), np.array(places))


def absolute_errors(world, bundle) -> np.ndarray:
    """Metres, without any alignment."""
    out = []
    for k in range(len(world.centre)):
        xy = np.array([[800.0, 600.0], [300.0, 300.0]])
        true = PosedPlacement(world.camera, world.centre[k] * (1, 1, -1), world.R[k], world.ground).project(xy)
        found = PosedPlacement(
            bundle.lenses[0].camera, bundle.centre[k] * (1, 1, -1), bundle.R_map_camera[k], bundle.ground
        ).project(xy)
        out.append(np.hypot(*(found - true).T))
    return np.concatenate(out)


def test_known_points_pull_the_map_to_their_places(rng):
    world = make_world(rng, gps_m=3.0)
    alone = bundle_adjust(world.problem)
    held = bundle_adjust(replace(world.problem, marks=marks_of(world, rng)))
    assert np.median(absolute_errors(world, held)) < 0.1 < np.median(absolute_errors(world, alone))
    loose = bundle_adjust(replace(world.problem, marks=marks_of(world, rng, shared=20.0)))
    off = [np.median(absolute_errors(world, b)) for b in (loose, held)]
    assert off[0] > 2.0 * off[1], "points that share an unknown error tell no more than the map's shape"


def test_derivatives_of_known_points(rng):
    world = make_world(rng, strips=1, a_strip=3, camera=Camera(1600, 1200, 1200.0, k1=-0.06), relief=2.0)
    p = replace(world.problem, marks=marks_of(world, rng, views=(0, 2)))
    state, h = BundleState.start(p), 1e-6

    def terms(state):
        return mark_terms(p.marks, state, cameras_of(p, state), p.lens_of, world.ground)

    found = terms(state)
    for k, view in enumerate(p.marks.view.tolist()):
        for j in range(8):
            step = np.zeros(6 * len(p.views) + 2)
            step[6 * view + j if j < 6 else 6 * len(p.views) + j - 6] = h
            ahead, behind = (terms(state.moved(s * step, np.zeros(p.ties.spots))).residual[k] for s in (1, -1))
            expected = found.by_view[k][:, j] if j < 6 else found.by_lens[k][:, j - 6]
            assert (ahead - behind) / (2 * h) == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_without_fixes_the_map_stays_where_it_was(rng):
    world = make_world(rng)
    relative = replace(
        world.problem,
        fix_of=np.zeros(0, np.intp),
        fix_xy=np.zeros((0, 2)),
        fix_noise=FixNoise.none(),
        held=np.array([0]),
    )
    bundle = bundle_adjust(relative)
    assert bundle.centre[0, :2] == pytest.approx(world.problem.views[0].centre[:2], abs=0.05)
    assert np.sqrt(np.mean(map_errors(world, bundle) ** 2)) < 1.0


def test_turns_and_their_logarithms(rng):
    turn = rng.normal(0, 0.8, (50, 3))
    assert log_rotation(exp_rotation(turn)) == pytest.approx(turn, abs=1e-12)
    assert log_rotation(exp_rotation(np.zeros((1, 3)))) == pytest.approx(np.zeros((1, 3)))


def test_fixes_share_what_they_share():
    def fix(frame, time, flight=0, white=0.5):
        return PositionObservation(frame, np.zeros(2), np.eye(2) * (white**2 + 4.0), flight, time, 2.0, 60.0, 1.0)

    fixes = [fix(0, 0.0), fix(1, 60.0), fix(2, 0.0, flight=1)]
    C = FixNoise.of(fixes).covariance
    assert C[0, 0] == pytest.approx(0.25 + 4.0 + 1.0) and C[0, 2] == 0.0
    assert C[0, 1] == pytest.approx(4.0 * np.exp(-1.0) + 1.0)
    many = [fix(k, 2.0 * k) for k in range(20)]
    xy = np.zeros((20, 2))
    xy[7] = (80.0, 0.0)
    information = fix_noise(many, xy).information
    assert information[7, 7] < 1e-3 * information[8, 8], "a blunder is put aside"
    assert fix_noise([], np.zeros((0, 2))).information.shape == (0, 0)
    untimed = FixNoise.of([replace(f, time_s=None) for f in fixes[:2]]).covariance
    assert untimed == pytest.approx(np.full((2, 2), 1.0) + 4.25 * np.eye(2)), "without a time only the bias is shared"


def test_the_ground_is_found_under_what_stands_on_it(rng):
    xy = rng.uniform(-100, 300, (3000, 2))
    land = 8.0 * np.sin(xy[:, 0] / 60.0) + 5.0 * np.cos(xy[:, 1] / 80.0)
    up = land + rng.normal(0, 0.3, 3000)
    up[rng.uniform(size=3000) < 0.2] += 12.0
    field = fit_ground(xy, up, np.full(3000, 0.3), 20.0)
    inner = (np.abs(xy - 100.0) < 170.0).all(axis=1)
    assert np.median(np.abs(field.at(xy[inner]) - land[inner])) < 0.4
    flat = fit_ground(xy, rng.normal(0, 0.3, 3000), np.full(3000, 0.3), 20.0)
    assert np.abs(flat.up).max() < 0.25, "noise makes no hills"
    assert fit_ground(xy[:5], up[:5], np.ones(5), 20.0).is_level
    assert isinstance(flat, HeightField)


def test_known_heights_hold_the_world_level(rng):
    """Where the ground is known, poses lie over it: the ground of their own may bow with them."""
    world = make_world(rng, relief=4.0)
    known = replace(world.ground, up=world.ground.up + 77.0)  # its level is not used
    alone, told = bundle_adjust(world.problem), bundle_adjust(replace(world.problem, terrain=known))
    xy = world.centre[:, :2]

    def shape(ground):
        return ground.at(xy) - np.median(ground.at(xy))

    assert np.std(shape(told.ground) - shape(world.ground)) < 0.05
    height = [np.std(b.centre[:, 2] - world.centre[:, 2]) for b in (alone, told)]
    assert height[1] < height[0]
    assert np.sqrt(np.mean(map_errors(world, told) ** 2)) < 1.0
