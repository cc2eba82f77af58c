"""Show a skin with a force/torque sensor on the page and in the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, cast

from palpate.contact.estimator import ContactEstimator
from palpate.sensors.fused.estimator import FusedEstimator
from palpate.sensors.taxels.section import SkinSection
from palpate.sensors.taxels.view import TaxelView
from palpate.setup.setup import Setup
from palpate.setup.view import Words
from palpate.setup.wrench_view import zero_section
from palpate.viewer.run_report import Run


class FusedView(TaxelView):
    """The view of a skin with a force/torque sensor."""

    words: ClassVar[Mapping[str, Words]] = {
        **TaxelView.words,
        "tangential": ("tangential force", 1e2, "% of the normal force (one standard deviation)"),
        "gain": ("error of the skin's gain", 1e2, "% (one standard deviation)"),
        "floor": ("and of its force", 1.0, "N (one standard deviation)"),
        "alarm": ("false alarms", 1e2, "%"),
        "turns": ("the prior is updated", 1.0, "times"),
        "crease": ("edges are sharp from", 1.0, "°"),
    }

    def skin(self, setup: Setup) -> Setup:
        """Return the `Setup` of the skin alone."""
        return setup.answering(setup.sensors[SkinSection.name].kind)

    def report(self, run: Run, setup: Setup, estimator: ContactEstimator) -> Run:
        """Return the `Run` with the skin's body and section, and one on the history of the wrenches' zero.

        Raises:
            InputError: matplotlib is not installed, or the link's surface cannot be read.
            GeometryError: its file has no usable surface.
        """
        made = cast("FusedEstimator", estimator)
        run = super().report(run, setup, made.taxels)
        return replace(
            run,
            method="and places are the skin's, forces those that explain skin and wrench within friction",
            uncertainties=(*run.uncertainties, "the wrench's noise", "what the skin's forces are off by"),
            sections=(*run.sections, *zero_section(made.zero_history())),
        )
