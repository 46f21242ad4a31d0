"""Constants beside the drawing: what a drawing or a controller states of an arm, and what the arm is.

A table of the best rigid stand-in of a model in the branch nearest to the nominal table (`truearm.arm.nearest_table`),
each constant with its change, its standard uncertainty and whether the readings determine it.

The uncertainty is that of the model: errors of its coefficients move its points, and these the constants refitted to
them. Added is that of the refit: where the model is no rigid arm, other poses of the region give other constants.

Files of constants: what all their formats share, from a model's rigid stand-in to the file and back to its tips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm import Arm, Chain, DHTable, drawn_table, nearest_table
from truearm.arm.nearest_table import NEARLY_PARALLEL, ON_ONE_LINE_MM, drawn_convention
from truearm.choices import Convention
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import parse_file
from truearm.identification.estimation.diagnostics import UNIDENTIFIABLE_SHARE
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms import ArmState, InducedProcess
from truearm.models import Compensator
from truearm.models.compensator import FREE_PARTS
from truearm.models.identified_model import to_identified
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.exports.formats.rigid_arm import RigidArm, TermsOf, all_constants, best_rigid_arm
from truearm.wings.exports.targets.manifest import (
    Direction,
    Frame,
    Manifest,
    check_joints,
    check_not_coupled,
    read_manifest,
)

Unit = Literal["rad", "mm"]

IDENTIFIABLE, NOT_IDENTIFIABLE, NOMINAL = "identifiable", "not identifiable", "nominal"
SUM_WITH_BASE, SUM_WITH_TIP = "only as a sum with the base", "only as a sum with the tip"
SUM_ALONG_AXES, SUM_ABOUT_LINE = "only as a sum along parallel axes", "only as a sum about a common line"
# Steps of the difference quotients of a smooth function: their error is a ten-thousandth of a derivative or less.
STEP_RAD, STEP_MM = 1e-7, 1e-4
# Where no prior moves a constant by more, in rad or mm, the evidence has pruned what it depends on.
_PRUNED = 1e-12
# A constant that neither changed nor is uncertain by as much is held: nothing in the model moves it, and what is left
# is the rounding of the refit [mm, rad]. No readings tell 10 nm, or that at a distance of 1 m.
_HELD = {"mm": 1e-5, "rad": 1e-8}


@dataclass(frozen=True)
class ArmConstant:
    """One constant of an arm.

    Attributes
    ----------
    place : str
        ``base``, the name of a joint, or ``tip``.
    name : str
        theta, d, a, alpha, beta or b of a row; x, y, z and the rotation vector rx, ry, rz of the base; x, y, z of the
        tip in the nominal flange.
    unit : {"rad", "mm"}
    nominal, identified : float
    std : float
        Standard uncertainty; of the base's rotation vector those of small turns about the base's axes.
    status : str
        Whether the readings determine it; ``nominal`` where it is held, as nothing that the model has learned moves it.
    """

    place: str
    name: str
    unit: Unit
    nominal: float
    identified: float
    std: float
    status: str

    @property
    def change(self) -> float:
        """Identified less nominal."""
        return self.identified - self.nominal


@dataclass(frozen=True, eq=False)
class ConstantsTable:
    """Constants of an arm beside the drawing.

    Attributes
    ----------
    nominal, identified : DHTable
        Both with the nominal flange. The identified base is in the frame of the model's points.
    joint_names : tuple of str
    constants : tuple of ArmConstant
        From base to tip.
    is_placed : bool
        Whether the base was free: it then says where the arm stood, and nothing of the arm.
    largest_prior : mapping of str to float
        By unit, the largest standard deviation of a constant before the readings, and before evidence shrank it. Where
        the tip is on an axis no readings tell the constants that place it, which are less certain than that.
    """

    nominal: DHTable
    identified: DHTable
    joint_names: tuple[str, ...]
    constants: tuple[ArmConstant, ...]
    is_placed: bool
    largest_prior: Mapping[Unit, float]

    def in_own_base(self) -> ConstantsTable:
        """The table in the arm's own base frame: that of the nominal table, unless the base was known."""
        if not self.is_placed:
            return self
        at_base = [
            replace(one, identified=one.nominal, std=0.0, status=NOMINAL) if one.place == "base" else one
            for one in self.constants
        ]
        return replace(self, identified=replace(self.identified, base=self.nominal.base), constants=tuple(at_base))


def constants_table(
    model: Compensator, rigid: RigidArm, *, convention: Convention | None = None, free: Sequence[str] | None = None
) -> ConstantsTable:
    """The constants of a model's rigid stand-in beside the nominal ones.

    Parameters
    ----------
    model : Compensator
        Fitted.
    rigid : RigidArm
        Its stand-in.
    convention : {"dh", "mdh"}, optional
        By default that of the nominal arm's own table.
    free : sequence of {"base", "tip"}, optional
        Parts that take the change of a sum; by default those that were free in the fit.
    """
    nominal, fit = rigid.nominal.chain, rigid.fit
    convention = convention or drawn_convention(nominal)
    if free is None:
        free = [part for part in FREE_PARTS if any(term.group == part for term in fit.perturbed_chain.terms)]
    drawing = drawn_table(nominal, convention)

    def table_of(chain: Chain) -> DHTable:
        return _with_flange(nearest_table(chain, nominal, convention=convention, free=free), drawing.flange)

    identified = table_of(fit.chain)
    entries = list(_entries(drawing, rigid.nominal.joint_names, free))
    by_coefficient = np.empty((len(entries), len(fit.coefficients)))
    steps = _steps(rigid)
    for k, step in enumerate(steps):
        shifted = np.zeros(len(steps))
        shifted[k] = step
        moved = table_of(fit.perturbed_chain.with_constants(fit.coefficients + shifted))
        by_coefficient[:, k] = _changes(identified, moved, entries) / step
    std, remains = _uncertainties(model, rigid, by_coefficient)
    largest = _largest_prior(fit)
    remains = np.where(std > [largest[one.unit] for one in entries], 1.0, remains)
    was, now = _values(drawing, entries), _values(identified, entries)
    constants = tuple(
        ArmConstant(
            entry.place,
            entry.name,
            entry.unit,
            old,
            new,
            u,
            entry.status or _status(entry.unit, change=new - old, u=u, remains=share),
        )
        for entry, old, new, u, share in zip(
            entries, was.tolist(), now.tolist(), std.tolist(), remains.tolist(), strict=True
        )
    )
    return ConstantsTable(drawing, identified, rigid.nominal.joint_names, constants, "base" in free, largest)


class _Entry(NamedTuple):
    """Which number of a table a constant is."""

    place: str
    name: str
    unit: Unit
    status: str  # empty: by the uncertainties
    row: int = -1
    axis: int = -1


def _entries(drawing: DHTable, joint_names: Sequence[str], free: Sequence[str]) -> Iterator[_Entry]:
    for turns, names in ((False, "xyz"), (True, ("rx", "ry", "rz"))):
        for axis, name in enumerate(names):
            yield _Entry("base", name, "rad" if turns else "mm", "", axis=axis)
    n, modified = len(joint_names), drawing.convention == "mdh"
    parallel = np.abs(np.cos(drawing.alpha) * np.cos(drawing.beta)) > np.cos(NEARLY_PARALLEL)
    on_one_line = parallel & (np.abs(drawing.a) < ON_ONE_LINE_MM)
    end = 0 if modified else n - 1
    for row, joint in enumerate(joint_names):
        across = row + 1 if modified else row  # the row with the motion to the next axis
        along = SUM_ALONG_AXES if row < n - 1 and parallel[across] else ""
        about = SUM_ABOUT_LINE if row < n - 1 and on_one_line[across] else ""
        if row == 0 and "base" in free and (n > 1 or modified):
            along = about = SUM_WITH_BASE
        elif row == n - 1 and "tip" in free:
            along = about = SUM_WITH_TIP
        at_end = (SUM_WITH_BASE if modified else SUM_WITH_TIP) if row == end else ""
        yield _Entry(joint, "theta", "rad", about, row)
        yield _Entry(joint, "d", "mm", along, row)
        yield _Entry(joint, "a", "mm", at_end, row)
        yield _Entry(joint, "alpha", "rad", at_end, row)
        if parallel[row] and row != end:
            yield _Entry(joint, "beta", "rad", "", row)
        if on_one_line[row] and row != end:
            yield _Entry(joint, "b", "mm", "", row)
    for axis, name in enumerate("xyz"):
        yield _Entry("tip", name, "mm", "", axis=axis)


def _with_flange(table: DHTable, flange: FloatArray) -> DHTable:
    """The table with another flange and the same tips: readings of points do not tell how a flange is turned."""
    tip = table.flange[:3, :3] @ table.tip_in_flange + table.flange[:3, 3] - flange[:3, 3]
    return replace(table, flange=flange, tip_in_flange=flange[:3, :3].T @ tip)


def _largest_prior(fit: IdentificationResult) -> dict[Unit, float]:
    """See `ConstantsTable`: the prior that is offered, or that of the readings of an arm with larger errors."""
    chain = fit.perturbed_chain
    found: dict[Unit, float] = {"rad": 0.0, "mm": 0.0}
    stds = [(term, term.prior_stds) for term in all_constants(chain.chain, ())]
    stds += [(term, fit.prior_std[own]) for term, own in zip(chain.terms, chain.columns, strict=True)]
    for term, std in stds:
        if term.group not in FREE_PARTS:
            unit: Unit = "rad" if any(term.direction[:3]) else "mm"
            found[unit] = max(found[unit], float(std.max()))
    return found


def _steps(rigid: RigidArm) -> list[float]:
    terms = rigid.fit.perturbed_chain.terms
    return [STEP_RAD if any(term.direction[:3]) else STEP_MM for term in terms for _ in range(term.n_coefficients)]


def _values(table: DHTable, entries: Sequence[_Entry]) -> FloatArray:
    turn = Rotation.from_matrix(table.base[:3, :3]).as_rotvec()
    return np.array([_value(table, entry, turn) for entry in entries])


def _changes(before: DHTable, after: DHTable, entries: Sequence[_Entry]) -> FloatArray:
    """Small changes of the constants, those of the base's rotation as a small turn about the base's axes."""
    R = before.base[:3, :3].T @ after.base[:3, :3]
    turn = np.array([R[2, 1], R[0, 2], R[1, 0]])
    return np.array([_value(after, entry, turn) - _value(before, entry, np.zeros(3)) for entry in entries])


def _value(table: DHTable, entry: _Entry, turn: FloatArray) -> float:
    if entry.place == "tip" and entry.row < 0:
        return float(table.tip_in_flange[entry.axis])
    if entry.row < 0:
        return float(turn[entry.axis] if entry.unit == "rad" else table.base[entry.axis, 3])
    return float(getattr(table, entry.name)[entry.row])


def _uncertainties(model: Compensator, rigid: RigidArm, by_coefficient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard uncertainties of the constants, and the share of their prior variance that remains, 0 to 1.

    The refit is linear in the model's points near its result: ``dx = S G^T W dp``, with S its covariance and G, W the
    derivatives and weights of its residuals; and ``dp = J dc`` by the coefficients c of the model.
    """
    fit = rigid.fit
    refit = np.maximum(np.einsum("ij,jk,ik->i", by_coefficient, fit.covariance, by_coefficient), 0.0)
    remains = _share(refit, by_coefficient**2 @ fit.prior_std**2)
    if (identified := to_identified(model)) is None:
        return np.sqrt(refit), remains
    weights = fit.references[0].weights ** 2
    of_model, state = identified.fit_, model.state(Session(rigid.poses))
    projected = np.zeros((len(fit.coefficients), len(of_model.coefficients)))
    by_point = np.empty((len(by_coefficient), 3, len(rigid.poses)))
    of_rigid = fit.perturbed_chain.derivatives(ArmState(fit.perturbed_chain.chain, rigid.poses), fit.coefficients)
    full = of_model.perturbed_chain.derivatives(state, of_model.coefficients)
    for (rows, _, G), (_, _, J) in zip(of_rigid, full, strict=True):
        projected += np.tensordot(G * weights[:, rows], J, axes=([1, 2], [1, 2]))
        by_point[:, :, rows] = np.tensordot(by_coefficient @ fit.covariance, G * weights[:, rows], axes=1)
    by_model = by_coefficient @ fit.covariance @ projected
    of_readings = np.maximum(np.einsum("ij,jk,ik->i", by_model, of_model.covariance, by_model, optimize=True), 0.0)
    remains = np.maximum(remains, _share(of_readings, by_model**2 @ of_model.prior_std**2))
    of_readings += _by_processes(of_model, state, by_point)
    return np.sqrt(refit + identified.birge_ratio_**2 * of_readings), remains


def _by_processes(of_model: IdentificationResult, state: ArmState, by_point: FloatArray) -> FloatArray:
    """Variances (k,) by what processes do between their inducing points, with derivatives (k, 3, n) by the points."""
    out = np.zeros(len(by_point))
    for term, std in of_model.processes:
        assert isinstance(term.basis, InducedProcess)
        by_motion = of_model.perturbed_chain.motion_derivatives(state, of_model.coefficients, term.place)
        along = np.tensordot(by_motion, np.array(term.direction), axes=(1, 0))
        out += std**2 * term.basis.remainder_of_sums(state, np.einsum("kcn,nc->kn", by_point, along))
    return out


def _status(unit: Unit, *, change: float, u: float, remains: float) -> str:
    if max(abs(change), u) < _HELD[unit]:
        return NOMINAL
    return NOT_IDENTIFIABLE if remains > UNIDENTIFIABLE_SHARE else IDENTIFIABLE


def _share(variance: FloatArray, prior_variance: FloatArray) -> FloatArray:
    """Share of a variance in that of the prior; 1 where the evidence has pruned all that a constant depends on."""
    depends = prior_variance > _PRUNED**2
    return np.where(depends, variance / np.where(depends, prior_variance, 1.0), 1.0)


MAX_BYTES = 1_000_000


@dataclass(frozen=True, eq=False)
class ConstantsRequest:
    """What a file of constants is to hold.

    Parameters
    ----------
    model : Compensator
        Fitted.
    path : Path
        Written whole or not at all.
    angles, region
        As in `best_rigid_arm`.
    frame : {"base", "reference"}
        Frame of the file's root: the arm's own base, or that of the model's points.
    convention : {"dh", "mdh"}, optional
        Of tables; by default that of the nominal arm's own table.
    source : str or path, optional
        The robot's own file, where a format changes one.
    """

    model: Compensator
    path: Path
    angles: npt.ArrayLike | None = None
    region: str = ""
    frame: Frame = "base"
    convention: Convention | None = None
    source: str | Path | None = None

    def rigid_arm(self, nominal: Arm | None = None, *, terms_of: TermsOf | None = None) -> RigidArm:
        """The model's best rigid stand-in."""
        return best_rigid_arm(self.model, self.angles, region=self.region, nominal=nominal, terms_of=terms_of)

    def table(self) -> tuple[RigidArm, ConstantsTable]:
        """The best rigid stand-in and its constants in the frame of the file."""
        rigid = self.rigid_arm()
        table = constants_table(self.model, rigid, convention=self.convention)
        return rigid, table.in_own_base() if self.frame == "base" else table


class ConstantsFile(NamedTuple):
    """A file of constants before it is written.

    Attributes
    ----------
    rigid : RigidArm
        The stand-in.
    chain : Chain
        That of the file.
    content : callable
        The content with a manifest.
    remarks : tuple of str
        What changed, where a file has no place to say it.
    """

    rigid: RigidArm
    chain: Chain
    content: Callable[[Manifest], str | bytes]
    remarks: tuple[str, ...] = ()


class Written(NamedTuple):
    """A file of constants that was written: the stand-in, with its loss; what the file states; what changed."""

    rigid: RigidArm
    manifest: Manifest
    remarks: tuple[str, ...]


class Write(Protocol):
    """Writes a file of constants."""

    def __call__(self, model: Compensator, path: str | Path, **options: Any) -> Written:
        """Write the file; parameters are those of `ConstantsRequest`.

        Returns
        -------
        Written

        Raises
        ------
        InputError
            As `best_rigid_arm`, and if the format cannot hold this arm.
        """
        ...


def writer(
    format: str,
    file_of: Callable[[ConstantsRequest], ConstantsFile],
    direction: Direction = "predict",
    read: Callable[[Path], object] = read_manifest,
) -> Write:
    """The function that writes files of one format, with their check poses, and reads them back."""

    def write(model: Compensator, path: str | Path, **options: Any) -> Written:
        request = ConstantsRequest(model, Path(path), **options)
        if request.source is None or format not in ("urdf", "mjcf"):
            check_not_coupled(model.arm_, format)
        rigid, chain, content, remarks = file_of(request)
        tips = chain.tip_in_base(check_joints(model))
        manifest = Manifest.of(model, format, tips=tips, direction=direction, frame=request.frame, loss=rigid.loss)
        made = content(manifest)
        with atomic_file(path, read=read) as beside:
            beside.write_bytes(made.encode() if isinstance(made, str) else made)
        return Written(rigid, manifest, remarks)

    return write


def reader(chain_of: Callable[[bytes, Manifest], Chain]) -> Callable[[str | Path, npt.ArrayLike], FloatArray]:
    """The function that gives (n, 3) tips [mm] by a file of one format at joints (n, n_joints) [rad, or mm].

    It raises InputError if the file is missing, too large or damaged.
    """

    def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
        manifest = read_manifest(path)
        return parse_file(path, lambda content: chain_of(content, manifest).tip_in_base(joints), limit_bytes=MAX_BYTES)

    return tips
