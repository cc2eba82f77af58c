"""Show any sensor that measures wrenches in the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, cast

import numpy as np
from jaxtyping import Bool, Float

from palpate.contact.estimator import ContactEstimator
from palpate.contact.locate import Locator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.setup.setup import Setup
from palpate.setup.view import Facts, SensorView, Words
from palpate.signals.zero_filter import ZeroHistory, ZeroStatus
from palpate.surfaces.mesh import Mesh
from palpate.viewer.plots import zeros
from palpate.viewer.report import Section, percent, picture
from palpate.viewer.run_report import Run

_LISTED = ("crease", "noise_source")  # settings that `wrench_settings` does not have


class WrenchView(SensorView):
    """The view of a sensor of wrenches: its surface, its settings and the drift of its bias."""

    words: ClassVar[Mapping[str, Words]] = {"crease": ("edges are sharp from", 1.0, "°")}

    def settings(self, facts: Mapping[str, object]) -> Facts:
        """Return (words, value) for each setting that `wrench_settings` does not list."""
        return super().settings({name: facts[name] for name in _LISTED if name in facts})

    def report(self, run: Run, setup: Setup, estimator: ContactEstimator) -> Run:
        """Return the run with the surface, settings, uncertainties, and sections on the sensor and its bias.

        Raises:
            GeometryError: an implicit surface cannot be drawn.
        """
        made = cast("WrenchEstimator", estimator)
        smooth, sensor, rate = made.filter, made.sensor, made.rate
        filtered = "none" if smooth is None or rate is None else smooth.describe(rate)
        drawn, method = made.locator.surface.drawn(), setup.estimate.method.replace("_", " ")
        run = replace(
            run,
            method=f"compensated {self.compensated(made)}, and located on {setup.link.name} by the {method} method",
            body=(drawn.vertices, drawn.faces),
            settings=(*wrench_settings(setup, made.locator, sensor.noise, filtered), *run.settings),
            uncertainties=("the sensor's noise", *(f"{name} uncertainty" for name in self.uncertain(setup, made))),
            sections=zero_section(made.zero_history()),
        )
        return self.sections(run, setup, made)

    def compensated(self, estimator: WrenchEstimator) -> str:
        """Return the words that say how the wrenches were compensated."""
        return "without a payload model"

    def uncertain(self, setup: Setup, estimator: WrenchEstimator) -> tuple[str, ...]:
        """Return the sources of uncertainty, other than the noise, that the ellipses include."""
        return () if setup.link.mount_covariance is None else ("the mounting's",)

    def sections(self, run: Run, setup: Setup, estimator: WrenchEstimator) -> Run:
        """Return the run with this sensor's own sections; here without."""
        return run


def zero_section(history: ZeroHistory | None) -> tuple[Section, ...]:
    """Return the report's section on the bias over time, in a tuple; () if the bias was not followed."""
    if history is None or not len(history.time):
        return ()
    held: Bool[np.ndarray, " n"] = history.status != ZeroStatus.FREE
    drawn = zeros(history.time, history.zero, history.deviation, held)
    caption = (
        "How far the zero has gone since the start, with 95 % bands. Below, green: followed, as nothing touched; grey: "
        "held, as something touched or may have, while the band grows."
    )
    facts = (
        ("held", f"{percent(float(np.mean(held)))} of the time"),
        ("unsure", f"at most by {_spread(history.deviation)} (one standard deviation of one channel)"),
    )
    return (Section("Zero", pictures=(picture(drawn, caption),), settings=facts),)


def _spread(deviation: Float[np.ndarray, "n m"]) -> str:
    """Return the largest standard deviation in words: N and N mm for six channels, else mV."""
    most = np.max(deviation, axis=0)
    if len(most) != 6:
        return f"{1e3 * float(most.max()):.2g} mV"
    return f"{float(most[:3].max()):.2g} N and {1e3 * float(most[3:].max()):.2g} N mm"


def wrench_settings(
    setup: Setup, locator: Locator, noise: Float[np.ndarray, "6 6"] | None, filtered: str = "none"
) -> Facts:
    """Return (words, value) for each setting that a wrench sensor's results depend on, defaults included.

    Args:
        setup: the link and its sensors.
        locator: the locator on the surface.
        noise: covariance of a reading, force first [N, N m]; None: not known.
        filtered: the filter, in words.
    """
    surface = locator.surface
    facets = f", {len(surface.faces):,} facets" if isinstance(surface, Mesh) else ""
    tare = setup.estimate.tare
    return (
        ("method", setup.estimate.method.replace("_", " ")),
        ("friction, at most", f"{setup.estimate.friction:g} (tangent of the angle between force and normal)"),
        ("torsion, at most", f"{1e3 * setup.estimate.torsion:g} mm (torque about the normal over normal force)"),
        ("a contact", f"begins at {locator.on:.3g} N, ends at {locator.off:.3g} N"),
        ("noise of a reading", "not known" if noise is None else _noise(np.sqrt(np.diag(noise)))),
        ("filter", filtered),
        ("surface", f"{setup.link.name}{facets}, {1e3 * surface.size:.4g} mm across"),
        *([] if tare is None else [("tare", f"over the first {tare:g} s")]),
    )


def _noise(deviation: np.ndarray) -> str:
    return f"{deviation[:3].max():.3g} N and {deviation[3:].max():.3g} N m (one standard deviation, largest axis)"
