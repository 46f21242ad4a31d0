"""Files of constants: what all their formats share, from a model's rigid stand-in to the file and back to its tips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy.typing as npt

from truearm.arm import Arm, Chain
from truearm.choices import Convention
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import parse_file
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.formats.constants_table import ConstantsTable, constants_table
from truearm.wings.exports.formats.rigid_arm import RigidArm, TermsOf, best_rigid_arm
from truearm.wings.exports.targets.manifest import (
    Direction,
    Frame,
    Manifest,
    check_joints,
    check_not_coupled,
    read_manifest,
)

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
