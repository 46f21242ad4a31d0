"""The routine of an interim check: ten poses in a cone, four in each seat of a bar, nine points on a sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.atomic_write import check_new_file
from truearm.typing import FloatArray, NameArray
from truearm.wings.planning.designs.candidates import ON_A_TABLE, bar_places, seat_poses
from truearm.wings.planning.designs.planned_readings import TIP_SPHERE, checked_seed
from truearm.wings.planning.designs.proposal import LENGTH_U_MM
from truearm.wings.planning.designs.sampling import SEAT_SECTOR, postures, reach
from truearm.wings.planning.designs.template import lengths_path, write_aims, write_length_rows
from truearm.wings.planning.designs.tour import order_of_few_moves
from truearm.wings.planning.designs.workspace import Surroundings, draw_points, stance

CONE, BAR_ENDS, SPHERE = "cone", ("bar A", "bar B"), "ball"
"""Names of the artefacts, the same in every check."""

IN_CONE, IN_BAR = 10, 4
# Half the diameter of a stylus tip [mm]: the tip's centre is this far from the sphere.
_TIP_RADIUS_MM = 3.0
_CENTRES = 60  # places of the sphere to try
_SWING_DEG, _ROLL_DEG = 10.0, 10.0


@dataclass(frozen=True, eq=False)
class CheckRoutine:
    """The poses of an interim check.

    Attributes
    ----------
    arm : Arm
    angles : (n, n_joints) array
        In the order of measurement [rad].
    seat, sphere : (n,) array of str
        What the tip touches; empty where it is the other.
    notes : tuple of str
        An instruction for each pose.
    length_mm : float or None
        Of the bar.
    tip_sphere_mm : float or None
        Diameter of the sphere that the centre of the tip is on.
    """

    arm: Arm
    angles: FloatArray
    seat: NameArray
    sphere: NameArray
    notes: tuple[str, ...]
    length_mm: float | None
    tip_sphere_mm: float | None

    def save(self, path: str | Path, *, force: bool = False) -> tuple[Path, ...]:
        """Write the session to fill in and, with a bar, the file of its length beside it.

        Both must be new, unless `force` replaces them.

        Raises
        ------
        InputError
            If a file exists or cannot be written.
        """
        files = [Path(path), *([] if self.length_mm is None else [lengths_path(path)])]
        for file in files:
            check_new_file(file, force=force, endings=(".csv",))
        if self.length_mm is not None:
            write_length_rows([BAR_ENDS], self.length_mm, LENGTH_U_MM, files[1])
        diameters = np.where(self.sphere == "", "", f"{self.tip_sphere_mm}")
        names = {"seat": self.seat, "sphere": self.sphere, TIP_SPHERE: diameters}
        used = {name: column for name, column in names.items() if (column != "").any()}
        write_aims(self.arm, self.angles, files[0], names=used, notes=self.notes)
        return tuple(files)


def check_routine(
    arm: Arm,
    *,
    length_mm: float | None = None,
    sphere_mm: float | None = None,
    surroundings: Surroundings = ON_A_TABLE,
    seed: int = 0,
) -> CheckRoutine:
    """Plan an interim check: the same routine every time.

    Parameters
    ----------
    arm : Arm
        Base z up, at least five rotary joints.
    length_mm : float, optional
        Length of a bar between its seats; without it the routine has no bar.
    sphere_mm : float, optional
        Diameter of a sphere; without it the routine has no sphere.
    surroundings : Surroundings
        Table and boxes.
    seed : int

    Raises
    ------
    InputError
        If the arm does not reach an artefact, or a size is not positive.
    """
    cone = seat_poses(arm, seats=1, poses=IN_CONE, seed=seed, surroundings=surroundings)
    assert cone.seat_points is not None  # poses in seats
    parts = [(CONE, cone.angles, cone.seat_points[0])]
    if length_mm is not None:
        bar = bar_places(arm, 1, length_mm=length_mm, poses=IN_BAR, seed=seed, surroundings=surroundings)
        assert bar.seat is not None
        assert bar.seat_points is not None
        for name, planned in zip(BAR_ENDS, ("B1a", "B1b"), strict=True):
            here = bar.seat == planned
            parts.append((name, bar.angles[here], bar.seat_points[here][0]))
    tip_sphere_mm = None if sphere_mm is None else sphere_mm + 2 * _TIP_RADIUS_MM
    if sphere_mm is not None:
        angles, centre = _on_sphere(arm, sphere_mm, surroundings, np.random.default_rng([checked_seed(seed), 1]))
        parts.append((SPHERE, angles, centre))
    names = np.concatenate([np.full(len(angles), name) for name, angles, _ in parts])
    order = order_of_few_moves(arm, all_angles := np.concatenate([angles for _, angles, _ in parts]), names)
    names, is_sphere = names[order], names[order] == SPHERE
    notes = _notes(names.tolist(), {name: at for name, _, at in parts})
    return CheckRoutine(
        arm,
        all_angles[order],
        np.where(is_sphere, "", names),
        np.where(is_sphere, names, ""),
        notes,
        length_mm,
        tip_sphere_mm,
    )


def _on_sphere(
    arm: Arm, diameter_mm: float, surroundings: Surroundings, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Poses with the tip on the upper half of a sphere: four points on the equator, four half way up, the pole."""
    if not (np.isfinite(diameter_mm) and diameter_mm > 0):
        raise InputError(f"expected the positive diameter of a sphere in mm, got {diameter_mm}")
    turn = np.pi / 2 * np.arange(4)
    rows = [
        np.column_stack([np.cos(up) * np.cos(turn + up), np.cos(up) * np.sin(turn + up), np.full(4, np.sin(up))])
        for up in (0.0, np.pi / 4)
    ]
    normals = np.concatenate([*rows, [[0.0, 0.0, 1.0]]])
    lean = normals + [0.0, 0.0, 1.0]  # half way between the normal and the vertical: the hand has room
    axes = -lean / np.linalg.norm(lean, axis=1, keepdims=True)
    where = stance(arm)
    for centre in draw_points(where, _CENTRES, sector=SEAT_SECTOR, rng=rng):
        if not surroundings.holds(centre[None])[0]:
            continue
        tips = centre + (diameter_mm / 2 + _TIP_RADIUS_MM) * normals
        start = postures(arm, tips, where, swing_std_deg=_SWING_DEG, roll_std_deg=_ROLL_DEG, rng=rng)
        angles, reason = reach(arm, tips, axes, start)
        if (reason == "").all() and surroundings.leaves_free(arm.chain, angles).all():
            return angles, centre
    raise InputError(
        f"arm {arm.name!r} reaches no sphere of {diameter_mm:g} mm from all sides", hint="check --table-top and --avoid"
    )


def _notes(names: Sequence[str], places: dict[str, FloatArray]) -> tuple[str, ...]:
    """Where each artefact is put, at its first pose; then what the tip touches."""
    out = []
    for row, name in enumerate(names):
        touch = f"tip on {name}" if name == SPHERE else f"tip in {name}"
        x, y, z = places[name]
        fix = f"fix {name} at x {x:.0f} y {y:.0f} z {z:.0f} mm; " if name not in names[:row] else ""
        out.append(fix + touch)
    return tuple(out)
