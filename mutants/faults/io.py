"""Files in and out."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

CONTACTS = "tests/io/test_contacts_csv.py tests/io/test_contacts_files.py"

FAULTS: list[Fault] = [
    *of(
        "contact/table.py",
        CONTACTS,
        ("half a covariance is read", "covariance[:, *_UPPER[::-1]] = variances", "covariance[:, *_UPPER[::-1]] = 0.0"),
        (
            "an answered row with half a point passes",
            "np.isfinite(estimate.point).all(axis=1)",
            "np.isfinite(estimate.point).any(axis=1)",
        ),
        ("normal for force", "vectors[:, 6:9].copy()", "vectors[:, 3:6].copy()"),
    ),
    *of(
        "io/contacts/csv.py",
        CONTACTS,
        ("a cut line is a row", 'text.rpartition(b"\\n") if torn else (text, b"", b"")', '(text, b"", b"")'),
        ("samples that are no whole numbers pass", "whole == np.rint(whole)", "np.isfinite(whole)"),
    ),
    *of(
        "io/schema.py",
        "tests/io/test_models.py tests/io/test_rig.py",
        (
            "covariances that are not symmetric pass",
            "np.abs(matrix_of_one - matrix_of_one.T).max(initial=0.0) > _ROUNDING",
            "False",
        ),
        ("negative variances pass", "np.linalg.eigvalsh(matrix_of_one).min(initial=0.0) < -_ROUNDING", "False"),
        (
            "infinity where a number is asked for",
            "self.said.infinite and abs(value) >= _LARGEST",
            "abs(value) >= _LARGEST",
        ),
    ),
    *of(
        "io/units.py",
        "tests/io",
        ("units with a space are unknown", "_squeezed(unit)", "unit", "known_unit"),
    ),
    *of(
        "io/tables/dialect.py",
        "tests/io",
        ("thousands are read as they come", "_THOUSANDS.fullmatch(text)", "False"),
        ("a comma is a decimal point", "doubted and not commas", "False"),
    ),
    *of(
        "io/logs/naming.py",
        "tests/io",
        ("a rig may contradict the header", "not same", "False"),
    ),
    *of(
        "io/logs/transforms.py",
        "tests/io/test_tf.py",
        ("seconds of a stamp count as nanoseconds", "whole * 10**9", "whole"),
        (
            "messages of one length are alike",
            "same &= (_bytes(data, start + at, len(wanted)) == np.frombuffer(wanted, dtype=np.uint8)).all(axis=1)",
            "pass",
        ),
        (
            "what /tf_static says holds even if /tf moves it",
            "self.constant is not None and not self.contradicted",
            "self.constant is not None",
        ),
        ("what never moves has gaps", "max_gap if seen.moves else np.inf", "max_gap"),
    ),
    *of(
        "io/logs/joints.py",
        "tests/io/test_tf.py",
        ("positions are taken in the order of the message", "found[:, names.index(name)]", "found[:, k]"),
        ("a joint that is missing does not matter", "sound & concerned & known", "sound & concerned"),
    ),
    *of(
        "io/urdf.py",
        "tests/io/test_urdf.py",
        ("a mesh's scale is left out", "points * scale", "points"),
        ("a mirrored mesh keeps its facets", "faces[:, ::-1] if mirrored else faces", "faces"),
        (
            "angles are about axes that turn along",
            'Rotation.from_euler("xyz", turn)',
            'Rotation.from_euler("XYZ", turn)',
        ),
        ("a joint that follows has no offset", "factor * row[source] + offset", "factor * row[source]"),
    ),
]
