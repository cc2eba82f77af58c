"""From a wrench to a contact: choice, status, covariance, distance from the bounds; and what comes before it."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "contact/ellipse.py",
        "tests/viewer/test_scene.py",
        ("an ellipse is turned the other way", "0.5 * math.atan2(xy, half)", "0.5 * math.atan2(-xy, half)"),
        ("the ellipse of a covariance that is not known", "math.isfinite(xx + xy + yy)", "True"),
    ),
    *of(
        "contact/_kernel.py",
        "tests/contact/test_locate.py tests/contact/test_uncertainty.py tests/contact/test_residual.py",
        ("the candidate furthest from the last", "gap < nearest", "gap > nearest or best < 0", "_choose"),
        (
            "the sign of the cross term in the ellipse",
            "spread[1, 1] * x * x - 2.0 * spread[0, 1] * x * y",
            "spread[1, 1] * x * x + 2.0 * spread[0, 1] * x * y",
        ),
        (
            "chi-square of one degree of freedom",
            "_outside(places[i], places[best], t, spread, det, _CHI2_95)",
            "_outside(places[i], places[best], t, spread, det, 3.84)",
        ),
        (
            "a candidate on the other side is not ambiguous",
            "z * z > limit * (spread[0, 0] + spread[1, 1])",
            "z * z < 0.0",
        ),
        ("no hysteresis", "abs(settings[OFF])", "abs(settings[ON])", "_gate"),
        ("the last contact is forgotten", "state[HAS_PREVIOUS] = 1.0", "pass", "_estimate"),
        ("the last contact is kept after it lifts", "state[HAS_PREVIOUS] = 0.0", "pass", "_estimate"),
        (
            "covariance without its cross terms",
            "t[a, i] * spread[a, c] * t[c, j]",
            "t[a, i] * spread[a, c] * t[c, j] if a == c else 0.0",
        ),
        (
            "samples out of sequence know each other",
            "copy_into(start, state)",
            "copy_into(state, state)",
            "estimate_many",
        ),
        ("one covariance for all samples", "len(noises) > 1", "len(noises) > 1000000", "estimate_many"),
        ("implausible candidates count", "max(1, plausible) if explained else 0", "count"),
        ("what noise makes on a flat surface is a bend", "_BENT * square", "0.0 * square", "_jumped"),
        ("no bend is seen", "square * share < _NEAR**2", "square * share < 0.0", "_jumped"),
        (
            "nothing is looked for while a touch begins",
            "_elsewhere(wrench, unit, noise, nodes, corners, settings, limit, place, t, spread, found, free)",
            "False",
        ),
        (
            "a touch begins for ever",
            "1.0 < state[SAMPLES] <= EARLY",
            "1.0 < state[SAMPLES]",
        ),
    ),
    *of(
        "contact/_touch.py",
        "tests/contact/test_whole_touches.py tests/contact/test_locate.py",
        ("what is met last comes first", "return gap < 0.0", "return gap > 0.0"),
        ("the larger friction angle comes first", "found[i, 4] < found[j, 4]", "found[i, 4] > found[j, 4]"),
        (
            "the torsion is bound by its own size",
            "abs(torque) <= settings[TORSION] * abs(pressing)",
            "abs(torque) <= settings[TORSION] * abs(torque)",
        ),
        ("the friction is not bound", "found[i, 4] <= settings[FRICTION]", "found[i, 4] >= 0.0"),
        ("what a branch loses is its gain", "gain = first_loss - loss", "gain = loss - first_loss"),
        ("no branch ever wins", "margin > top", "margin > top + np.inf", "_winner"),
        (
            "a touch that begins within another is at one place",
            "of_candidate[best] = 0",
            "of_candidate[:] = 0",
            "_anew",
        ),
        ("each branch is a rival", "one[_GAIN] - late > -_threshold(one, _APART)", "one[_GAIN] < np.inf", "rival"),
        ("beyond the bounds is no rival", "not near[i] < _NEAR**2", "near[i] > 0.0", "_born"),
        ("all are told apart", "one[_GAIN] - late > -_threshold(one, _APART)", "one[_GAIN] > np.inf", "rival"),
    ),
    *of(
        "contact/_edges.py",
        "tests/contact/test_edges.py",
        ("edges of one facet's normal", "step = line[13] / _NORMALS", "step = 0.0 * line[13] / _NORMALS"),
        ("torsion says nothing of a normal", "_below(grip) * _below(hold)", "_below(grip)"),
        (
            "the place along the edge has no spread",
            "_EVEN * (sums[7 + 3 * k + j] / total - mean[k] * mean[j])",
            "0.0 * sums[7 + 3 * k + j]",
        ),
    ),
    *of(
        "contact/_cones.py",
        "tests/contact/test_edges.py",
        (
            "the slope by the normal, mirrored",
            "cross_into(m, line[3:6], turns[1])",
            "cross_into(line[3:6], m, turns[1])",
        ),
        ("friction does not turn", "near[k] * np.sqrt(1.0 + settings[FRICTION] ** 2) / size", "0.0 * near[k] / size"),
        (
            "at a corner towards one normal after the other",
            "square[i, k] += turn[a, i] * weights[a, b] * turn[b, k]",
            "square[i, k] += 0.0 * turn[a, i]",
        ),
        ("few edges looked at", "rows = np.empty(_LOOKED, dtype=np.int64)", "rows = np.empty(64, dtype=np.int64)"),
    ),
    *of(
        "contact/_bounds.py",
        "tests/contact/test_residual.py",
        (
            "the slope of the torsion's bound",
            "sign * (dboth - tau * dpress) / pressing + settings[TORSION] * dpress",
            "sign * (dboth - tau * dpress) / pressing - settings[TORSION] * dpress",
        ),
        ("the way onto the friction cone", "(normal + mu * slip) / (1.0 + mu * mu)", "normal + 0.0 * mu"),
        ("torsion bound by what pressed before", "settings[TORSION] * grip", "settings[TORSION] * slip"),
        (
            "the moment of a force at the point",
            "rows[a, k], rows[a, 3 + k] = -work[k], t[a, k]",
            "rows[a, k], rows[a, 3 + k] = work[k], t[a, k]",
        ),
        ("a squared distance", "np.sqrt(max(0.0, total))", "max(0.0, total)", "_metric"),
        (
            "the nearest of all steps is not kept",
            "distance < best",
            "distance > best or best == np.inf",
        ),
    ),
    *of(
        "contact/_slopes.py",
        "tests/contact/test_uncertainty.py tests/laws/test_equation_laws.py",
        ("a row of the sandwich", "half * right[j, k]", "half * right[i, k]", "sandwich_into"),
    ),
    *of(
        "sensors/_compensation.py",
        "tests/contact/test_estimator.py tests/contact/test_stream.py",
        ("inertia pushes the wrong way", "-load[_MASS] * acceleration[k]", "load[_MASS] * acceleration[k]"),
        ("a reading at its range is not saturated", "abs(wrench[k]) >= limits[k]", "abs(wrench[k]) > limits[k]"),
        (
            "the centre's error is left out",
            "error[3 + k] += moment[k] + column[9 + k]",
            "error[3 + k] += column[9 + k]",
        ),
        (
            "the tare's error is left out",
            "kept * constant[0, a, b] + constant[1, a, b]",
            "kept * constant[0, a, b]",
        ),
        (
            "the sensor's noise is left out",
            "kept * constant[0, a, b]",
            "0.0 * constant[0, a, b]",
        ),
        ("a deviation for a variance", "jolt * jolt * constant[2, a, b]", "jolt * constant[2, a, b]"),
        (
            "the mass's error under acceleration is left out",
            "rotation[j, k] - acceleration[k] * load[_SLOPE + j] - mean[k, j]",
            "rotation[j, k] - mean[k, j]",
        ),
        (
            "what a tare took off is still doubted",
            "rotation[j, k] - acceleration[k] * load[_SLOPE + j] - mean[k, j]",
            "rotation[j, k] - acceleration[k] * load[_SLOPE + j]",
        ),
    ),
    *of(
        "contact/_fused.py",
        "tests/contact/test_fused.py",
        ("misplaced by the forces that the skin says", "second[i, r, q] = total", "second[i, r, q] += 0.0", "_again"),
        (
            "the prior is not written anew",
            "level[i] = max(mean[3 * i], 0.2 * contacts[i, 6])",
            "level[i] = contacts[i, 6]",
        ),
        (
            "friction is not bounded",
            "variance -= aa * aa + bb * bb + 2.0 * ab * ab + 2.0 / 3.0 * (aa * bb - ab * ab)",
            "variance -= 0.0 * aa",
        ),
    ),
    *of(
        "contact/fused.py",
        "tests/contact/test_fused.py",
        ("the way into the cones is free", "totals[0, 6] += further", "totals[0, 6] += 0.0"),
    ),
    *of(
        "contact/zero_follower.py",
        "tests/contact/test_zero_follower.py",
        (
            "temperature is taken off once only",
            "zero = state.zero + warmer * (self.drift.thermal + state.coefficient[self._weighs :])",
            "zero = state.zero",
        ),
        ("slopes are known", "ways[: len(state.zero), kept:] = warmer * np.eye(len(state.zero))", "pass"),
    ),
    *of(
        "contact/_taxels.py",
        "tests/contact/test_taxel_estimator.py",
        ("rests do not wander", "variance[k] += walk * walk * max(passed, 0.0)", "variance[k] += 0.0 * passed"),
        ("a touch that shows late is in the rest", "touched[k] > slot[0] - AFTER", "touched[k] > slot[0] + 1000.0"),
        (
            "light touches are in the rest",
            "sign * (waiting[k] - baseline[k]) > _HELD * np.sqrt(variance[k] + noise[k] * noise[k] / frames)",
            "frames < 0.0",
        ),
        (
            "a mean a second old is as good as new",
            "variance[k] = (1.0 - gain) * before + since",
            "variance[k] = (1.0 - gain) * before",
        ),
    ),
    *of(
        "contact/fused_estimator.py",
        "tests/contact/test_fused_estimator.py",
        (
            "the zero from both sides is not used",
            "follower.sensor.follow(zero)",
            "follower.sensor.follow(None)",
            "_both_sides",
        ),
    ),
    *of(
        "contact/_taxels.py",
        "tests/contact/test_taxels_anywhere.py",
        ("places of taxels are taken for exact", "len(covariances) > 0", "len(covariances) < 0"),
        (
            "places of taxels err each for itself",
            "share * covariances[cells[i], a, b]",
            "share * share * covariances[cells[i], a, b]",
        ),
        ("doubt along the normal leans the ellipse", "half[a, b] - normal[a] * across", "half[a, b]"),
    ),
    *of(
        "contact/_taxel_fit.py",
        "tests/contact/test_taxels_anywhere.py",
        ("the fit of a touch ends where it begins", "x[:] = trial", "x[2:] = trial[2:]"),
        ("pressure is taken for a Gaussian", "shape = (_SHAPE * peak) ** 2", "shape = 0.0"),
        (
            "nothing is thought of a touch",
            "sure = np.array([_BESIDE**-2, _BESIDE**-2, 0.0, _WIDER**-2])",
            "sure = np.array([1e-9, 1e-9, 0.0, 1e-9])",
        ),
        ("a misfit leaves the ellipse", "max(1.0, _cost(touch, x, prior, np.zeros(4)) / max(end - 4, 1))", "1.0"),
        ("the body does not bend", "bend[0, c] += scale * ahead * at[c, k]", "bend[0, c] += 0.0 * ahead * at[c, k]"),
    ),
    *of(
        "contact/ring_locator.py",
        "tests/contact/test_ring_locator.py",
        ("slippery bodies are held as any", "min(1.0, shear / usual)", "1.0"),
        ("bodies are held by more than was seen", "min(1.0, shear / usual)", "shear / usual"),
    ),
    *of(
        "contact/_ring.py",
        "tests/contact/test_ring_locator.py",
        ("every ring has the first one's misfit", "misfit[ring + e, k]", "misfit[e, k]"),
        (
            "neighbours carry a contact the other way",
            "state[c, 0] + along / (outer - depth)",
            "state[c, 0] - along / (outer - depth)",
        ),
        (
            "a wider contact carries the skin as any",
            "force * (moved[0, 0] + z * (moved[0, 1] + z * moved[0, 2]))",
            "force * moved[0, 0]",
        ),
        ("a tilted skin is pressed as an upright one", "slope / outer", "0.0"),
        (
            "friction pulls with the skin",
            "min(max(-along / gives, -grip), grip)",
            "min(max(along / gives, -grip), grip)",
        ),
        ("friction holds more than it can", "min(max(-along / gives, -grip), grip)", "-along / gives"),
        ("the usual width is none", "held[c] if e else priors[2]", "held[c] if e else 0.0"),
    ),
    *of(
        "contact/locating_threads.py",
        "tests/contact/test_locating_threads.py",
        (
            "a run that goes on begins as after a rest",
            "self._run = self._run_from(self._run)",
            "self._run = self._run_from(self._locator.no_contact())",
        ),
        ("the Locator forgets what threads left", "self._locator.memory[:] = self._run.memory()", "self._run.memory()"),
    ),
    *of(
        "contact/_kernel.py",
        "tests/contact/test_locating_threads.py",
        (
            "a bad sample counts as one without contact",
            "forced[i] < 0 and _gate(wrenches[i], noise, settings, state) == _NO_CONTACT",
            "_gate(wrenches[i], noise, settings, state) == _NO_CONTACT",
            "first_free",
        ),
    ),
]
