"""Taxels from pokes: laws of the equations, and of what comes out on a bench whose truth is geometry."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from claims.evidence.taxel_limit import priors_of
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.modules import LAYOUTS, ModuleLayout
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking import Priors, TaxelCalibration, calibrate_taxels, paper
from palpate.sensors.taxels.poking import solve as solving
from palpate.sensors.taxels.poking.paper import nearest_in_metric
from palpate.sensors.taxels.poking.plan import candidates, known_after, plan_pokes
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.priors import tied
from palpate.sensors.taxels.poking.response import charted, learned, seen_among
from palpate.sensors.taxels.poking.rigid_groups import fitted, single
from palpate.sensors.taxels.poking.solve import solve
from palpate.sensors.taxels.poking.systematic_errors import Nuisances, predicted
from palpate.spatial.pose import Pose
from palpate.surfaces import Cylinder, Mesh
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench, PokeErrors, PokeSession

RNG = np.random.default_rng
QUIET = PokeErrors(0.02, 0.002, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def skin() -> Forearm:
    return Forearm.of()


@pytest.fixture(scope="module")
def link(skin: Forearm) -> Mesh:
    return Mesh.from_arrays(*skin.cone.mesh())


@pytest.fixture(scope="module")
def session(skin: Forearm) -> PokeSession:
    rng = RNG(11)
    return PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND).session(rng, 600)


@pytest.fixture(scope="module")
def from_cad(skin: Forearm, link: Mesh, session: PokeSession) -> TaxelCalibration:
    return calibrate_taxels(session.pokes, surface=link, start=skin.cad(RNG(5)), priors=priors_of(MIX))


def made(seed: int, count: int = 5, configurations: int = 2) -> Pokes:
    """Wrenches of any kind, one answer each."""
    rng = RNG(seed)
    turn = Pose.from_rotation_vector(rng.normal(size=(count, 3)), np.zeros((count, 3))).rotation
    origin, configuration = 0.1 * rng.normal(size=(count, 3)), np.arange(count) % configurations
    ones, starts = np.ones(count), np.arange(count + 1)
    wrench = rng.normal(size=(count, 6))
    return Pokes(wrench, turn, origin, configuration, starts, 0 * starts[1:], ones, 1, np.eye(6), ones, ones)


def test_the_torque_changes_as_differences_say() -> None:
    pokes, rng, step = made(1), RNG(2), 1e-6
    points = 0.1 * rng.normal(size=(5, 3))
    small = [1e-2 * rng.normal(size=shape) for shape in ((2, 6), 6, (2, 6), (6, 6))]
    errors = Nuisances(*small)
    found = predicted(pokes, points, errors)
    for k in range(len(errors.vector())):
        move = np.zeros(len(errors.vector()))
        move[k] = step
        ends = [predicted(pokes, points, errors.moved(sign * move)).torque for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2 * step)
        for poke, d in enumerate(pokes.configuration.tolist()):
            own = [*range(6 * d, 6 * d + 6), *range(12, 18), *range(18 + 6 * d, 24 + 6 * d), *range(30, 66)]
            wanted = found.by_nuisance[poke, :, own.index(k)] if k in own else np.zeros(3)
            # rounding of the difference, and the third order in angles of 0.03 rad that is left out
            np.testing.assert_allclose(slope[poke], wanted, atol=3e-6)
    wrench = [
        predicted(replace(pokes, wrench=pokes.wrench + sign * step * np.eye(6)[3]), points, errors).torque
        for sign in (1.0, -1.0)
    ]
    np.testing.assert_allclose((wrench[0] - wrench[1]) / (2 * step), found.by_wrench[:, :, 3], atol=1e-8)


def test_lines_of_force_through_a_point_meet_there() -> None:
    pokes, point = made(3, 12), np.array([0.02, -0.01, 0.05])
    force = pokes.wrench[:, :3]
    place = pokes.rotation @ point + pokes.origin
    pure = replace(pokes, wrench=np.concatenate([force, np.cross(place, force)], axis=1))
    for weighted in (False, True):
        np.testing.assert_allclose(paper.free(paper.normal_equations(pure, weighted=weighted))[0], point, atol=1e-12)


def test_a_doubtful_poke_counts_less_and_a_rejected_one_not_at_all() -> None:
    pokes = made(4, 8)
    weight = np.array([1.0, 0.0] * 4)
    alone = paper.free(paper.normal_equations(pokes.picked(weight > 0)))
    np.testing.assert_allclose(paper.free(paper.normal_equations(replace(pokes, weight=weight))), alone, rtol=1e-12)


def test_nearest_in_a_metric_is_the_nearest_of_all_points_that_forces_press(link: Mesh) -> None:
    rng = RNG(6)
    root = rng.normal(size=(20, 3, 3))
    matrix = root @ np.swapaxes(root, 1, 2)
    centre, pressing = 0.04 * rng.normal(size=(20, 3)) + [0, 0, 0.1], rng.normal(size=(20, 3))
    found = nearest_in_metric(matrix, np.einsum("kij,kj->ki", matrix, centre), pressing, link)
    share = rng.dirichlet(np.ones(3), size=(len(link.faces), 12))
    points = np.einsum("fsc,fcx->fsx", share, link.vertices[link.faces])
    cost = [np.einsum("...i,ij,...j->...", points - c, a, points - c) for c, a in zip(centre, matrix, strict=True)]
    for k in range(20):
        pressed = link.normals @ pressing[k] < 0
        away = found[k] - centre[k]
        assert away @ matrix[k] @ away <= cost[k][pressed].min() + 1e-15
        onto, _, facet = link.project(found[k][None])
        assert np.linalg.norm(onto[0] - found[k]) < 1e-9
        near = np.linalg.norm(link.vertices[link.faces[pressed]] - found[k], axis=2).min()
        assert pressed[facet[0]] or near < 6e-3  # on an edge of a pressed facet


def test_the_derivative_of_places_is_that_of_moved_units(skin: Forearm, link: Mesh) -> None:
    for surface in (link, None):
        for units in (fitted(skin.layout, skin.places.positions, surface), single(skin.places.positions, surface)):
            move = 1e-5 * RNG(8).normal(size=(len(units), units.freedom))
            step = np.einsum("kif,kf->ki", units.jacobian, move[units.layout.module])
            ends = [units.moved(sign * move).places[0] for sign in (1.0, -1.0)]
            # facets of 2 mm: a place's derivative jumps by the angle between them, 0.065 rad
            np.testing.assert_allclose((ends[0] - ends[1]) / 2, step, atol=3e-6 if surface is not None else 1e-9)
            np.testing.assert_allclose(units.moved(move).away(units), move, atol=1e-7)


def test_a_flat_module_keeps_its_lengths_on_a_developable_link(skin: Forearm, link: Mesh) -> None:
    units = fitted(skin.layout, skin.places.positions, link)
    # the mesh's chords lie up to 17 um inside the cone
    np.testing.assert_allclose(units.places[0], skin.places.positions, atol=4e-5)


def test_modules_bent_on_their_link_are_as_long_as_laid_flat() -> None:
    """12 mm on a radius of 32 mm are 0.3 mm shorter seen from above; a module that is flat stays as it is."""
    skin, turn = Forearm.of(2), Pose.from_rotation_vector(np.array([0.3, -1.0, 0.4]), np.array([0.1, 0.0, 0.2]))
    flat = turn.apply(np.column_stack([skin.flat, np.zeros(24)]))
    outward = np.tile(turn.rotation[:, 2], (24, 1))
    plane = TaxelPlaces(flat, outward, module=skin.places.module)

    def lengths(layout: np.ndarray) -> np.ndarray:
        each = layout.reshape(2, 12, 2)
        return np.linalg.norm(each[:, :, None] - each[:, None], axis=3)

    exact = lengths(skin.layout.places)
    for places, bent, off in ((skin.places, True, 0.03e-3), (plane, True, 1e-9), (plane, False, 1e-9)):
        found = lengths(ModuleLayout.of(places, bent=bent).places)
        np.testing.assert_allclose(found, exact, atol=off)
    assert np.abs(lengths(ModuleLayout.of(skin.places).places) - exact).max() > 0.3e-3


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, np.pi / 2])
def test_a_long_module_bent_askew_is_as_long_as_laid_flat(angle: float) -> None:
    """6 x 18 mm wound at any angle round 32 mm, which shortens it by up to 0.25 mm."""
    flat = np.stack(np.meshgrid(np.linspace(-9e-3, 9e-3, 7), np.linspace(-3e-3, 3e-3, 3)), axis=-1).reshape(-1, 2)
    around, along = Rotation.from_euler("z", angle).as_matrix()[:2, :2] @ flat.T
    outward = np.column_stack([np.cos(around / 0.032), np.sin(around / 0.032), np.zeros(21)])
    bent = TaxelPlaces(0.032 * outward + along[:, None] * [0.0, 0.0, 1.0], outward, module=np.zeros(21, np.int64))
    found = ModuleLayout.of(bent, bent=True).places
    np.testing.assert_allclose(pdist(found), pdist(flat), atol=3e-6)


def test_the_covariance_holds_pokes_that_get_denser_to_one_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it has for them is what the answer moves by, taxel by taxel, were all contacts about it off by S g."""
    skin, rng = Forearm.of(1), RNG(17)
    link = Mesh.from_arrays(*skin.cone.mesh())
    pokes = PokeBench.drawn(rng, skin=skin, errors=QUIET, tip=HAND).session(rng, 240).pokes
    units, priors = fitted(skin.layout, skin.places.positions, link), priors_of(QUIET)
    response, denser = learned(charted(pokes, units)), 0.02  # so small that all is linear
    monkeypatch.setattr(solving, "learned", lambda _: response)
    monkeypatch.setattr(solving, "_STILL", 1e-10)
    monkeypatch.setattr(solving, "DENSER", 0.0)
    plain, chart = solve(pokes, units, priors), charted(pokes, units)
    seen, moved = seen_among(chart, response), np.zeros((3, 3))
    for taxel in np.unique(seen.origin[plain.weight > 0]):
        for way in denser / chart.spacing * np.eye(2):
            off = np.where((seen.origin == taxel)[:, None], seen.covariance @ way, 0.0)
            monkeypatch.setattr(solving, "seen_among", lambda *_, off=off: replace(seen, second=seen.second + off))
            by = solve(pokes, units, priors).units.away(plain.units)[0]
            moved += np.outer(by, by)
    monkeypatch.setattr(solving, "seen_among", seen_among)
    monkeypatch.setattr(solving, "DENSER", denser)
    held = solve(pokes, units, priors).covariance[:3, :3] - plain.covariance[:3, :3]
    scale = np.sqrt(np.diag(moved))
    np.testing.assert_allclose(held / np.outer(scale, scale), moved / np.outer(scale, scale), atol=0.2)


def test_derivatives_do_not_hold_what_a_contact_is_off_by(skin: Forearm, link: Mesh) -> None:
    """They are the same whatever the torque reads, if only torques are noisy: what is off is a contact or a torque."""
    rng = RNG(21)
    session = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND).session(rng, 60)
    units, none = fitted(skin.layout, skin.places.positions, link), Nuisances.none(7)
    seen = seen_among(charted(session.pokes, units), learned(charted(session.pokes, units)))
    pokes = replace(session.pokes, noise=np.diag([0.0, 0.0, 0.0, 2e-4, 2e-4, 2e-4]))
    other = replace(pokes, wrench=pokes.wrench + 0.02 * rng.normal(size=(60, 6)) * [0, 0, 0, 1, 1, 1])
    first, second = (solving._linear(each, units, units.jacobian, seen, none) for each in (pokes, other))
    assert np.abs(first.residual - second.residual).max() > 0.01
    for name in ("by_unit", "by_point"):
        np.testing.assert_allclose(getattr(first, name), getattr(second, name), atol=1e-12)


def test_torque_along_the_force_is_friction_once_bias_and_cross_talk_are_known(
    skin: Forearm, link: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = RNG(22)
    bench = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND)
    session = bench.session(rng, 400)
    friction = np.einsum("ni,ni->n", session.touches.force, session.touches.torque) / session.force**2
    units, none = fitted(skin.layout, skin.places.positions, link), Nuisances.none(7)
    true = replace(none, frames=bench.frames, bias=bench.bias, cross_talk=bench.cross_talk)
    seen = seen_among(charted(session.pokes, units), learned(charted(session.pokes, units)))
    told, plain = list[float](), solving._twist
    monkeypatch.setattr(solving, "_twist", lambda *given: told.append(plain(*given)) or told[-1])
    for known in (none, true):
        solving._linear(session.pokes, units, units.jacobian, seen, known)
    noise = 0.1 * 0.015 / float(np.median(session.force))  # a tenth of what torques scatter: what 400 pokes tell
    assert told[0] > 2.5e-3
    assert told[1] < np.hypot(friction.std(), np.sqrt(10.0) * noise) < 0.7e-3


@pytest.mark.parametrize("tail", [np.inf, 5.0])
def test_weights_that_fall_are_worth_what_their_estimates_scatter(tail: float) -> None:
    """The mean of 50 vectors by such weights, 4,000 times: its variance is that of its information."""
    draws, count = 4000, 50
    rng = RNG(23)
    wide = 1.0 if np.isinf(tail) else np.sqrt(tail / rng.chisquare(tail, (draws, count, 1)))
    residual = rng.normal(size=(draws, count, 3)) * wide
    middle, weight = np.zeros((draws, 1, 3)), np.ones((draws, count, 1))
    for _ in range(30):
        weight = (solving.TAIL + 3.0) / (solving.TAIL + ((residual - middle) ** 2).sum(axis=2, keepdims=True))
        middle = (weight * residual).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
    share = ((solving.TAIL + 3.0) / (solving.TAIL + (residual**2).sum(axis=2))).ravel()
    worth = solving._worth(0.5 * share, np.full(len(share), 0.5))
    assert 1.0 / (count * worth * share.mean()) == pytest.approx(middle.var(), rel=0.06)


def test_a_plan_looks_at_taxels_that_are_nearly_the_worst(skin: Forearm, link: Mesh) -> None:
    """So it needs no more pokes than one that looks at the worst alone."""
    units = single(skin.places.positions[:24], link)
    arm = PokeBench.drawn(RNG(0), skin=skin).arm
    options, priors = candidates(units, arm.pose(*arm.joints[:2].T), MIX.noise), priors_of(MIX)
    before = known_after(units, options, np.zeros(len(options.taxel)), priors, 2, units.each(3e-3, 0.09))
    wanted, alone = 2.3e-3, before.copy()
    taxel = np.arange(2 * 24).reshape(24, 2)
    by, greedy = units.jacobian, 0
    while True:
        traces = np.einsum("kif,kfg,kig->k", by, alone[taxel[:, :, None], taxel[:, None]], by)
        worst = int(traces.argmax())
        if traces[worst] <= wanted**2:
            break
        spread = options.rows @ alone
        inverse = np.linalg.inv(spread @ np.swapaxes(options.rows, 1, 2) + np.eye(3))
        best = int(np.einsum("caf,cab,cbf->c", spread[..., taxel[worst]], inverse, spread[..., taxel[worst]]).argmax())
        alone, greedy = alone - spread[best].T @ inverse[best] @ spread[best], greedy + 1
    plan = plan_pokes(units, before, options, wanted=wanted, pokes=200)
    assert plan.reached
    assert 24 < len(plan.chosen) <= greedy


def test_the_response_model_says_where_pokes_were_and_how_well(skin: Forearm, link: Mesh) -> None:
    rng = RNG(9)
    bench = PokeBench.drawn(rng, skin=skin, errors=QUIET, tip=HAND)
    session = bench.session(rng, 800)
    units = fitted(skin.layout, skin.places.positions, link)
    chart = charted(session.pokes, units)
    response = learned(chart)
    assert abs(response.reach - bench.layer.depth / np.sqrt(5.0)) < 0.4e-3  # of (1 + r^2 / h^2)^-5/2, and a tip of 4 mm
    seen = seen_among(chart, response)
    points, axes = seen.points(units)
    away = np.einsum("nca,nc->na", axes, points - session.contacts)[seen.found]
    told = np.einsum("na,na->n", away, np.linalg.solve(seen.covariance[seen.found], away[..., None])[..., 0])
    assert 0.25 < np.median(told) / 1.386 < 1.6  # of chi-square with two degrees of freedom; the model errs on the wide
    assert np.abs(np.median(away, axis=0)).max() < 0.1e-3


def test_pokes_with_three_answers_each_say_nothing_of_scatter(skin: Forearm, link: Mesh) -> None:
    """A level and a place take all three: what was left looked like any scatter, which grew, and spoilt the reach."""
    rng = RNG(9)
    bench = PokeBench.drawn(rng, skin=skin, errors=QUIET)
    pokes = bench.session(rng, 300).pokes
    chart = charted(pokes, fitted(skin.layout, skin.places.positions, link))
    order = np.argsort(-np.nan_to_num(chart.log, nan=-np.inf), axis=1)
    third = np.take_along_axis(chart.log, order[:, 2:3], axis=1)
    few = replace(chart, log=np.where(chart.log < third, np.nan, chart.log))  # the strongest three of each
    response = learned(few)
    assert abs(response.reach - bench.layer.depth / np.sqrt(5.0)) < 0.4e-3
    assert response.scatter == 0.2


def test_a_poke_between_taxels_lies_on_the_link_and_not_on_their_chord(skin: Forearm, link: Mesh) -> None:
    """A chord of 12 mm lies up to 0.6 mm below a radius of 32 mm: as a lever that would read as the sensor's gain."""
    rng = RNG(10)
    session = PokeBench.drawn(rng, skin=skin, errors=QUIET, tip=HAND).session(rng, 300)
    units = fitted(skin.layout, skin.places.positions, link)
    chart = charted(session.pokes, units)
    seen = seen_among(chart, learned(chart))
    points = seen.points(units)[0][seen.found]
    onto, normals, _ = link.project(session.contacts[seen.found])
    np.testing.assert_allclose(link.project(points)[0], points, atol=1e-9)
    off = points - onto
    across = off - np.einsum("nc,nc->n", off, normals)[:, None] * normals
    near = np.linalg.norm(across, axis=1) < 0.5e-3
    assert near.sum() > 30
    assert np.abs(np.einsum("nc,nc->n", off, normals)[near]).max() < 0.05e-3


def test_modules_from_cad_beat_the_paper_on_the_same_pokes(
    skin: Forearm, link: Mesh, session: PokeSession, from_cad: TaxelCalibration
) -> None:
    truth = skin.places.positions
    error = np.linalg.norm(from_cad.places.positions - truth, axis=1)
    pokes = session.pokes
    parts = [pokes.picked(pokes.configuration == number) for number in range(pokes.configurations)]
    each = [paper.on_surface(paper.normal_equations(part, weighted=True), link) for part in parts]
    usual = np.linalg.norm(np.ma.masked_invalid(each).mean(axis=0).filled(np.nan) - truth, axis=1)
    assert error.mean() < 2.5e-3  # 1.3 mm on average over seeds
    assert np.nanmean(usual) > 1.5 * error.mean()
    assert from_cad.places.module.tolist() == skin.layout.module.tolist()
    assert 0.3e-3 < from_cad.places.deviations().mean() < 3e-3
    assert (from_cad.places.relative < from_cad.places.deviations()).all()


def test_modules_from_nothing_lie_well_to_each_other(skin: Forearm, link: Mesh, session: PokeSession) -> None:
    found = calibrate_taxels(session.pokes, surface=link, layout=skin.layout, priors=priors_of(MIX)).places
    centred = found.positions - found.positions.mean(axis=0), skin.places.positions - skin.places.positions.mean(axis=0)
    left, _, right = np.linalg.svd(centred[0].T @ centred[1])
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    relative = np.linalg.norm(centred[0] @ turn - centred[1], axis=1)
    assert np.linalg.norm(found.positions - skin.places.positions, axis=1).mean() < 12e-3
    assert relative.mean() < 1.5e-3
    assert relative.max() < 4e-3


def test_taxels_never_touched_are_named_and_placed_by_their_module(skin: Forearm, link: Mesh) -> None:
    rng, among = RNG(13), np.flatnonzero(np.arange(84) % 12 < 6)
    pokes = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND).session(rng, 400, among=among).pokes
    found = calibrate_taxels(pokes, surface=link, start=skin.cad(rng), priors=priors_of(MIX))
    assert any("42 of 84 taxels never answered, they are placed by their modules" in said for said in found.notes)
    far = found.places.pokes == 0
    assert found.places.deviations()[far].mean() > found.places.deviations()[~far].mean()
    assert np.linalg.norm(found.places.positions - skin.places.positions, axis=1)[far].mean() < 3.5e-3


@pytest.mark.parametrize("method", ["free", "weighted", "surface", "taxels"])
def test_every_method_places_what_was_touched(method: str, skin: Forearm, link: Mesh) -> None:
    rng = RNG(17)
    pokes = PokeBench.drawn(rng, skin=skin, errors=QUIET, tip=HAND).session(rng, 300).pokes
    surface = link if method in ("surface", "taxels") else None
    found = calibrate_taxels(pokes, method=method, surface=surface, priors=priors_of(MIX)).places
    error = np.linalg.norm(found.positions - skin.places.positions, axis=1)[found.pokes > 3]
    assert np.median(error) < (12e-3 if surface is None else 4e-3)


def test_a_mirrored_layout_is_refused(skin: Forearm, link: Mesh) -> None:
    """Of modules that no numbering mirrors; 11 mm off, and the covariance of a fit said 1.7 mm."""
    rng, shape = RNG(11), skin.shape + [[4e-3 * (k % 4 == 1), 0.0] for k in range(12)]
    odd = replace(skin, shape=shape)
    pokes = PokeBench.drawn(rng, skin=odd, errors=MIX, tip=HAND).session(rng, 600).pokes
    mirrored = ModuleLayout(odd.layout.places * [-1.0, 1.0], odd.layout.module)
    for start in (None, odd.cad(RNG(5))):
        with pytest.raises(InputError, match=r"the layout of the modules is mirrored.*Layouts"):
            calibrate_taxels(pokes, surface=link, layout=mirrored, start=start, priors=priors_of(MIX))


def test_pokes_that_were_left_out_lie_where_the_others_predict(from_cad: TaxelCalibration) -> None:
    """The median of 300 squared distances with three degrees of freedom has a deviation of 8 %."""
    assert from_cad.validation.parts == 2
    assert 0.7 < from_cad.validation.ratio < 1.4


def test_what_cannot_be_is_said(skin: Forearm, link: Mesh, session: PokeSession) -> None:
    pokes = session.pokes
    with pytest.raises(InputError, match=r"'best' is not known.*Use"):
        calibrate_taxels(pokes, method="best")
    with pytest.raises(InputError, match=r"needs the link's surface.*Add"):
        calibrate_taxels(pokes, method="surface")
    with pytest.raises(InputError, match=r"modules need a layout.*Give"):
        calibrate_taxels(pokes, surface=link)
    other = ModuleLayout.repeated(LAYOUTS["ring12"], 5)
    with pytest.raises(InputError, match="layout has 60 taxels, but the pokes have 84: it belongs to another skin"):
        calibrate_taxels(pokes, surface=link, layout=other)
    with pytest.raises(InputError, match="pull along the normals of the start"):
        calibrate_taxels(replace(pokes, wrench=-pokes.wrench), surface=link, start=skin.cad(RNG(1)))
    unpaired = replace(pokes, wrench=np.roll(pokes.wrench, 1, axis=0))
    with pytest.raises(InputError, match=r"not 6.00 mm as in the layout.*in a row are of one poke"):
        calibrate_taxels(unpaired, surface=link, layout=skin.layout, start=skin.cad(RNG(1)), rescale=True)
    with pytest.raises(InputError, match=r"m from the sensor.*look like mm"):
        calibrate_taxels(replace(pokes, origin=1e3 * pokes.origin), surface=link, layout=skin.layout)
    with pytest.raises(NotIdentifiable, match="0 pokes can be used"):
        calibrate_taxels(replace(pokes, weight=np.zeros(len(pokes))), surface=link, layout=skin.layout)
    half = pokes.picked(np.isin(pokes.poke, np.unique(pokes.poke[pokes.taxel < 72]))[pokes.starts[:-1]])
    few = half.picked(np.bincount(half.poke, half.taxel >= 72, len(half)) == 0)
    with pytest.raises(NotIdentifiable, match="on modules 6"):
        calibrate_taxels(few, surface=link, layout=skin.layout)
    one = pokes.picked(pokes.configuration == 0)
    shifted = link.transformed(Pose.from_translation([8e-3, 0.0, 0.0]))
    said = [calibrate_taxels(one, surface=each, start=skin.cad(RNG(1))).warnings for each in (link, shifted)]
    assert any("only one arm configuration" in doubt for doubt in said[0])
    assert ["mm from the surface (median)" in " ".join(each) for each in said] == [False, True]


def test_a_planned_poke_shrinks_the_covariance_as_if_it_had_been_made(skin: Forearm, link: Mesh) -> None:
    units, poses = fitted(skin.layout, skin.places.positions, link), PokeBench.drawn(RNG(0), skin=skin).arm
    options = candidates(units, poses.pose(*poses.joints[:3].T), MIX.noise)
    deviations, priors = units.each(3e-3, 0.09), priors_of(MIX)
    before = known_after(units, options, np.zeros(len(options.taxel)), priors, 3, deviations)
    plan = plan_pokes(units, before, options, pokes=6)
    made = np.bincount(plan.chosen, minlength=len(options.taxel)).astype(float)
    after = known_after(units, options, made, priors, 3, deviations)
    again = plan_pokes(units, after, options, pokes=0)
    assert plan.worst[-1] == pytest.approx(again.worst[0], rel=1e-6)
    assert (np.diff(plan.worst) <= 1e-12).all()
    assert not plan.reached
    random = np.bincount(RNG(3).integers(0, len(options.taxel), 6), minlength=len(options.taxel)).astype(float)
    worse = plan_pokes(units, known_after(units, options, random, priors, 3, deviations), options, pokes=0)
    assert plan.worst[-1] <= worse.worst[0]


def test_known_distances_pull_as_their_squares_fall() -> None:
    places = 5e-3 * RNG(7).normal(size=(16, 3))
    priors = Priors(smooth=np.inf, neighbours=5e-3, spacing=5e-4)

    def cost(moved: np.ndarray) -> float:
        far = np.linalg.norm(moved[:, None] - moved, axis=2)
        pairs = {tuple(sorted((i, j))) for i in range(16) for j in np.argsort(far[i])[1:3].tolist()}
        return 0.5 * sum(((far[i, j] - 5e-3) / 5e-4) ** 2 for i, j in pairs)

    square, right = tied(single(places, None), priors)
    assert np.trace(square) >= 16 * 2 / 5e-4**2  # two of each, and no pair twice
    step = 1e-8 * np.eye(48)
    slope = [(cost(places + d.reshape(16, 3)) - cost(places - d.reshape(16, 3))) / 2e-8 for d in step]
    np.testing.assert_allclose(right, -np.array(slope), rtol=1e-4, atol=1e-1)


def test_what_is_smooth_is_left_alone_and_a_surface_needs_no_ties() -> None:
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), [0.0]), axis=-1).reshape(-1, 3) * 5e-3
    assert not np.any(tied(single(grid, None), Priors(smooth=5e-4))[1])
    raised = grid.copy()
    raised[12, 2] = 1e-3
    square, right = tied(single(raised, None), Priors(smooth=5e-4))
    assert right[38] < 0  # is pulled back, as others are about it
    assert square[38, 38] > 1 / 5e-4**2
    assert not np.any(tied(single(grid, Cylinder(0.03, 0.1)), Priors(smooth=5e-4))[0])
