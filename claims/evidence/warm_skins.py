"""Taxels that measure three axes while their temperature changes: corrected by a thermometer, and without one.

The skins are those of `claims.evidence.three_axis_skins`: a kelvin takes 0.12 % from what a sensor measures, as from
neodymium magnets, and adds 10 counts to each reading. The temperature swings by 5 K up and down while a unit is
calibrated, and rises by 10 K from the first touch of the test to the last. A thermometer is off by 0.05 K each frame.
"""

from collections.abc import Iterator

import numpy as np

from claims.evidence.three_axis_skins import SKINS, calibrated, errors_of, few_folds, trials
from claims.row import Row

SWINGS, WARMS = 5.0, 10.0  # K
SIZE = 4, 4
WAYS = {  # name -> swing in the calibration, and whether there is a thermometer
    "with a thermometer": (SWINGS, True),
    "without one": (SWINGS, False),
    "without one, calibrated at one temperature": (0.0, False),
}


def rows(small: bool) -> Iterator[Row]:
    """Force and its certainty by each way, for each kind of skin; small, of the first."""
    units, presses, touches = (1, 44, 25) if small else (4, 240, 150)
    for name, make in list(SKINS.items())[: 1 if small else None]:
        skins = [make(*SIZE, unit) for unit in range(units)]
        of = f"{units} skins of {SIZE[0] * SIZE[1]} {name}, {touches} touches each"
        for way, (swings, known) in list(WAYS.items())[: 1 if small else None]:
            with few_folds(small):
                trained = [(skin, calibrated(skin, presses, 10 + k, swings, known)) for k, skin in enumerate(skins)]
            errors, _, _ = errors_of(trials(trained, touches, 100, warms=WARMS, known=known))
            median, most = np.median(errors.normal), np.percentile(errors.normal, 95)
            met = bool(median <= 0.05) if known and not small else None  # few touches warm it at once
            got = f"{median:.2%} median, {most:.1%} 95 %"
            yield Row(f"normal force, {way}, {of}", "<= 5 % median" if known else "", got, met)
            share = float(np.mean(errors.forces))
            met = 0.93 <= share <= 0.97 if known and not small else None
            got = f"{share:.1%} of {len(errors.forces)}"
            yield Row(f"truth in the 95 % ellipse of the force, {way}, {of}", "93-97 %" if known else "", got, met)
