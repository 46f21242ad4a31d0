"""`operator_sheet`: the page by which an operator measures the points of a test plan; `fill_points` enters them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from truearm import __version__
from truearm.files.dates import now, parse_moment
from truearm.pages.drawings.page_record import PageRecord, input_files
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import model_file_fingerprint
from truearm.verbs.predict import Prediction
from truearm.wings.laboratory.standards.artefacts import example_artefacts
from truearm.wings.laboratory.standards.coordinate_origin import PROGRAM, CoordinateOrigin
from truearm.wings.laboratory.standards.layout import lay_out_tests
from truearm.wings.laboratory.standards.points_form import fill_points_form, write_points_form
from truearm.wings.laboratory.standards.positions import SHOULDER_SHARE
from truearm.wings.laboratory.standards.specification import example_specification
from truearm.wings.laboratory.verbs.verify import (
    ArtefactsLike,
    PlanLike,
    SpecificationLike,
    to_artefacts,
    to_plan,
    to_specification,
)

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.wings.laboratory.pages.operator_sheet import OperatorSheet

# Of the example specification [mm].
RANGE_MM = 2500.0


@dataclass(frozen=True, eq=False, repr=False)
class OperatorSheetResult(PageRecord):
    """The operator's sheet of a test plan.

    Attributes
    ----------
    sheet : OperatorSheet
        Plan, places of the artefacts and order of measuring.
    examples : tuple of str
        Inputs for which examples were used.
    files : tuple of Path
        The files that were read.
    """

    sheet: OperatorSheet
    examples: tuple[str, ...]
    files: tuple[Path, ...] = ()

    @property
    def n_points(self) -> int:
        """Number of points to measure."""
        return sum(len(one.points) for one in self.sheet.layout)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Which inputs are examples."""
        if not self.examples:
            return ()
        return (f"{' and '.join(self.examples)}: examples; give your own specification and artefacts",)

    def save_points(self, path: str | Path, *, tip_diameter_mm: float | None = None, force: bool = False) -> None:
        """Write the file of the points to measure, a row for each; `Prediction.fill` enters the coordinates.

        Parameters
        ----------
        path : path
            Ends in ``.csv``; must be new, unless `force` replaces it.
        tip_diameter_mm : float, optional
            Diameter of the stylus tip, whose centre the model of an arm gives [mm].

        Raises
        ------
        InputError
            If the file exists or cannot be written, or the diameter is that of no stylus tip.
        """
        write_points_form(self.sheet.layout, path, tip_diameter_mm=tip_diameter_mm, force=force)

    def page(self) -> Page:
        """Where the artefacts are placed, from which side and in which order the points are measured."""
        from truearm.wings.laboratory.pages.operator_sheet import operator_sheet_page

        return operator_sheet_page(self.sheet)

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        yield f"operator's sheet, {self.n_points} points of {self.sheet.plan.heading}"
        yield from self.remarks

    def _json(self) -> object:
        sheet = self.sheet
        return {
            "plan": sheet.plan.name,
            "points": self.n_points,
            "measuring_range_mm": sheet.measuring_range_mm,
            "examples": self.examples,
        }


@one_blas_thread()
def operator_sheet(
    plan: PlanLike, *, artefacts: ArtefactsLike | None = None, specification: SpecificationLike | None = None
) -> OperatorSheetResult:
    """Lay out the operator's sheet of a test plan: where the artefacts are placed, how and in which order to measure.

    Parameters
    ----------
    plan : VerificationPlan, str or path
        Test plan: ``iso10360-12``, ``asme-b89.4.22``, or a file of your own.
    artefacts : Artefacts or path, optional
        Certificates of the artefacts; by default examples.
    specification : Specification or path, optional
        States name and measuring range of the arm; by default an example of 2500 mm.

    Returns
    -------
    OperatorSheetResult
        `save_page` writes the sheet.

    Raises
    ------
    InputError
        If there is no such plan, or the artefacts do not suit it.

    Examples
    --------
    >>> import truearm as ta
    >>> print(ta.operator_sheet("asme-b89.4.22"))
    operator's sheet, 97 points of Articulated arm with contact probe (plan not confirmed against ASME B89.4.22-2004)
    measuring range and artefacts: examples; give your own specification and artefacts
    """
    from truearm.wings.laboratory.pages.operator_sheet import OperatorSheet

    examples = [what for what, given in (("measuring range", specification), ("artefacts", artefacts)) if given is None]
    arm = example_specification(RANGE_MM) if specification is None else to_specification(specification)
    range_mm = arm.measuring_range_mm
    certified = example_artefacts(range_mm) if artefacts is None else to_artefacts(artefacts)
    planned = to_plan(plan)
    sheet = OperatorSheet(
        planned,
        lay_out_tests(planned, certified, range_mm),
        certified,
        measuring_range_mm=range_mm,
        shoulder_mm=SHOULDER_SHARE * range_mm / 2,
        arm="" if specification is None else arm.name,
    )
    return OperatorSheetResult(sheet, tuple(examples), input_files(plan, artefacts, specification))


@one_blas_thread()
def fill_points(
    prediction: Prediction, path: str | Path, *, date: str | None = None, artefact_degC: float | None = None
) -> int:
    """Enter points into a file of points to measure, in the order of the readings (see `operator_sheet`).

    Entered too are the serial number of the arm, if the model or the session states it, what was accepted, and
    where the coordinates come from: version of truearm, model, SHA-256 of its file, readings outside its range.

    Parameters
    ----------
    prediction : Prediction
        What `predict` returned.
    path : path
        Its rows without coordinates are filled in, all or none.
    date : str, optional
        Day of the measurement, such as ``2026-11-03``, where none is stated; today by default.
    artefact_degC : float, optional
        Temperature of the artefacts [degC], where a test needs one and none is stated.

    Returns
    -------
    int
        Number of rows filled in.

    Raises
    ------
    InputError
        If there are more or fewer readings than rows without coordinates, a tip diameter is missing, the rows state
        the serial number of another arm, points have another origin, or the date or the temperature is implausible.

    Examples
    --------
    >>> import truearm as ta
    >>> sheet = ta.operator_sheet("iso10360-12")
    >>> sheet.save_points("points.csv", tip_diameter_mm=6)
    >>> artefacts = sheet.sheet.artefacts
    >>> poses = ta.rehearse("measuring7", "points.csv", artefacts=artefacts, preset="perfect").session
    >>> made = ta.simulate("measuring7", poses=30, preset="perfect", seed=1)
    >>> model = ta.fit("measuring7", made.session, model="nominal").model
    >>> ta.fill_points(ta.predict(model, poses), "points.csv", artefact_degC=20) == len(poses)
    True
    """
    moment = now() if date is None else parse_moment(date)
    model = prediction.model_name or prediction.model.kind
    digest = prediction.model_sha256 or model_file_fingerprint(prediction.model)
    return fill_points_form(
        path,
        prediction.points,
        day=moment.date(),
        artefact_degC=artefact_degC,
        serial_number=prediction.serial_number,
        accepted=" ".join(map(str, prediction.accepted)),
        origin=CoordinateOrigin(f"{PROGRAM} {__version__}", model, digest),
        outside=prediction.outside_training,
    )
