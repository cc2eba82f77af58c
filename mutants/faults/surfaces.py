"""Trees, patches, equations and normals."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

TREE = "tests/surfaces/test_bvh.py tests/laws/test_location_laws.py"

FAULTS: list[Fault] = [
    *of(
        "surfaces/_patch.py",
        TREE,
        ("contacts outside their patch", "u >= _INSIDE", "u >= -0.02", "solve_patch"),
        (
            "two weights of a facet change places",
            "out[0, 0], out[0, 1], out[0, 2] = s0, s1, s2",
            "out[0, 0], out[0, 1], out[0, 2] = s1, s0, s2",
        ),
        (
            "a sign in the square of the pitch",
            "pitch * pitch * (gj0 * gk1 - gk0 * gj1)",
            "pitch * pitch * (gj0 * gk1 + gk0 * gj1)",
        ),
        ("the shift goes the wrong way", "pitch / facing", "-pitch / facing"),
        ("the normal at a vertex", "mz - (x * fy - y * fx)", "mz + (x * fy - y * fx)"),
        ("one root of a cubic only", "count == 3", "count == 1", "_roots"),
    ),
    *of(
        "surfaces/_bvh.py",
        TREE,
        ("one contact twice, from two patches", "apart < 1e-14 and turned < 1e-12", "apart < 0.0"),
        ("boxes are widened by half the reach", "abs(pitch) * tan_limit", "0.5 * abs(pitch) * tan_limit"),
        (
            "patches are left out where a corner faces away",
            "c0 >= 0.0 and c1 >= 0.0 and c2 >= 0.0",
            "c0 >= 0.0 or c1 >= 0.0 or c2 >= 0.0",
        ),
        ("the wrench axis is shifted too", "pitch *= soft", "pass"),
        ("the limit of the angle is not kept", "tangent > tan_limit", "tangent > 2.0 * tan_limit", "_keep"),
        ("cones are cut off too early", "cos_limit - cos_t * cos_a - rounding", "cos_limit - cos_t * cos_a + 0.1"),
    ),
    *of(
        "surfaces/_nearest.py",
        "tests/surfaces tests/laws/test_surface_laws.py tests/contact/test_residual.py",
        (
            "height over the facet does not count",
            "_origin_to_triangle(q, out) + height * height",
            "_origin_to_triangle(q, out)",
        ),
        (
            "sides of a triangle go on for ever",
            "min(1.0, max(0.0, -(q[i, 0] * dx + q[i, 1] * dy) / square))",
            "-(q[i, 0] * dx + q[i, 1] * dy) / square",
        ),
        (
            "the nearest point is looked for on facets that face away",
            "fx * _sum(row, 3) + fy * _sum(row, 4) + fz * _sum(row, 5) >= 0.0",
            "fx * _sum(row, 3) + fy * _sum(row, 4) + fz * _sum(row, 5) <= 0.0",
        ),
        ("the nearest child hides the others", "gaps[depth] >= best", "gaps[depth] >= 0.5 * best"),
    ),
    *of(
        "surfaces/_normals.py",
        "tests/surfaces tests/laws/test_surface_laws.py",
        (
            "normals at corners are plain means",
            "normals[block, None, :] * weights[:, :, None]",
            "np.repeat(normals[block, None, :], 3, axis=1)",
        ),
        (
            "large facets count no more than small ones",
            "_corner_angles(vertices, faces[block]) * prominence",
            "_corner_angles(vertices, faces[block])",
        ),
        (
            "creases of twice the angle are smooth",
            "np.cos(max(crease, 0.0) + 1e-6)",
            "np.cos(2.0 * max(crease, 0.0) + 1e-6)",
        ),
    ),
    *of(
        "surfaces/_rays.py",
        "tests/surfaces/test_exposure.py",
        ("a facet behind the ray stops it", "far if far > 0.0 else np.inf", "abs(far)"),
        ("only the middle of a facet is asked", "min(_MOST, _sides(corners[facet], _SPACING))", "1"),
    ),
    *of(
        "surfaces/_exposure.py",
        "tests/surfaces/test_exposure.py",
        ("the ball goes everywhere", "places == places[0, 0, 0]", "places > 0"),
        ("a mesh inside out is covered", "areas[result].sum() > 0.01 * areas.sum()", "True"),
    ),
    *of(
        "surfaces/_repair.py",
        "tests/surfaces/test_mesh.py",
        ("vertices that differ by rounding stay apart", "np.sqrt(3.0)", "0.1"),
    ),
    *of(
        "surfaces/_topology.py",
        "tests/surfaces/test_topology.py",
        ("points beyond a cell's border are not looked for", "int(at + 1.01 / _CELL)", "int(at)"),
        (
            "an edge that runs twice the same way is paired",
            "ups == 1 and downs == 1",
            "ups >= 1 and downs >= 1",
        ),
        ("neighbours are walked in the order of their edges", "other < beside[best]", "False"),
    ),
    *of(
        "surfaces/_band.py",
        "tests/surfaces tests/calibration/test_skin_map.py",
        ("what is not positive is solved", "not pivot > 0.0", "pivot == 0.0"),
    ),
]
