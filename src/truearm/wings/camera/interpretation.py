"""What the poses of a robot and of a board mean: their forms, which rows belong together, where the camera is.

First the turns, which need nothing else; then the positions in closed form, which tell inverted poses, the place of
the camera and the size of the board. What is contradicted is refused with the interpretation that fits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.acceptance import contradict
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import InputError
from truearm.readings.columns import FACTOR
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.record import number_of
from truearm.wings.camera.closed_form import ClosedForm, Parallel, closed_form
from truearm.wings.camera.pose_files import Poses, described

# Tolerance of a pair: so many times the median of all, within these limits [deg].
TIMES_MEDIAN, LEAST_DEG, MOST_DEG = 4.0, 1.0, 5.0
# Share of the other images with which an image agrees.
AGREES = 0.75
# Shares of the images that must agree for the poses to belong together, and to be said wrong one by one.
TOGETHER, FEW_WRONG = 0.5, 1 / 3
# Images that do not agree among which exchanged ones are looked for.
MOST_EXCHANGED = 40


def turns(R: Rotation) -> FloatArray:
    """(n, n) angles [deg] between rotations, of ``R_i R_j^-1``."""
    q = R.as_quat()
    return np.asarray(np.degrees(2 * np.arccos(np.clip(np.abs(q @ q.T), 0.0, 1.0))))


@dataclass(frozen=True, eq=False)
class TurnTest:
    """How far the turns of robot and camera agree.

    Attributes
    ----------
    agree : (n,) bool array
        The images that agree with each other.
    rms_deg : float
        Root mean square difference of their turns.
    tolerance_deg : float
    off_deg : (n, n) array
        Difference between the turns of robot and camera from each image to each other one.
    """

    agree: BoolArray
    rms_deg: float
    tolerance_deg: float
    off_deg: FloatArray

    @classmethod
    def of(cls, robot: Rotation, camera: Rotation, *, all_right: bool = False) -> TurnTest:
        """Compare all pairs, and ignore what agrees least until the rest agree, unless all are known to be right."""
        off = np.abs(turns(robot) - turns(camera))
        n = len(off)
        tolerance = float(np.clip(TIMES_MEDIAN * np.median(off[np.triu_indices(n, 1)]), LEAST_DEG, MOST_DEG))
        fits, kept = off < tolerance, np.ones(n, dtype=bool)
        others = fits.sum(axis=1) - 1
        while not all_right and (left := int(kept.sum())) > 2:
            worst = int(np.where(kept, others, n).argmin())
            if others[worst] >= AGREES * (left - 1):
                break
            kept[worst] = False
            others -= fits[worst]
        among = off[np.ix_(kept, kept)][np.triu_indices(int(kept.sum()), 1)]
        return cls(kept, float(np.sqrt((among**2).mean())), tolerance, off)

    @property
    def share(self) -> float:
        """Share of the images that agree."""
        return float(self.agree.mean())

    @property
    def passes(self) -> bool:
        """Whether most images agree; three of a few agree by chance."""
        return bool(self.agree.sum() >= 3 and self.share > TOGETHER)


def wrong_rows(test: TurnTest, robot: Rotation, camera: Rotation, directions: FloatArray) -> dict[str, list[int]]:
    """What is wrong with each image that does not agree with the others, and its rows, counted from 0.

    Parameters
    ----------
    test : TurnTest
    robot, camera : Rotation
        Of the flange in the base, of the board in the camera.
    directions : (n, 3) array
        To the board, in the camera.
    """
    bad, good = np.flatnonzero(~test.agree), np.flatnonzero(test.agree)
    named: dict[str, list[int]] = {}

    def fits(seen: Rotation, row: int, least: float = AGREES) -> bool:
        apart = np.degrees((camera[good] * seen.inv()).magnitude())
        due = np.degrees((robot[good] * robot[row].inv()).magnitude())
        return bool((np.abs(apart - due) < test.tolerance_deg).mean() >= least)

    half = {f"{'xyz'[k]}": Rotation.from_rotvec(np.pi * np.eye(3)[k]) for k in (2, 0, 1)}
    for row in bad.tolist():
        for axis, turn in half.items():
            if fits(camera[row] * turn, row):
                named.setdefault(f"the board was seen half turned about its {axis} axis", []).append(row)
                break
        else:
            quarter = [Rotation.from_rotvec(s * np.pi / 2 * np.eye(3)[2]) for s in (1, -1)]
            along = Rotation.from_rotvec(np.pi * directions[row] / np.linalg.norm(directions[row]))
            near = bad.tolist() if len(bad) <= MOST_EXCHANGED else []
            others = [other for other in near if other != row and fits(camera[other], row)]
            if any(fits(camera[row] * turn, row) for turn in quarter):
                named.setdefault("the board was seen a quarter turned about its z axis", []).append(row)
            elif fits(along * camera[row] * half["z"], row):
                named.setdefault("the board was seen with the other tilt (a single marker has two)", []).append(row)
            elif len(others) == 1:
                named.setdefault("poses and images are exchanged among these", []).append(row)
            else:
                named.setdefault("the image is of another pose, or was taken while the arm moved", []).append(row)
    return named


def shifted(robot: Rotation, camera: Rotation, *, most: int = 3) -> int | None:
    """By how many rows all images are shifted against the poses, where that makes them agree; else None."""
    n = len(robot)
    for shift in (one for k in range(1, min(most, n - 4) + 1) for one in (k, -k)):
        images = slice(max(shift, 0), n + min(shift, 0))
        poses = slice(max(-shift, 0), n + min(-shift, 0))
        if (test := TurnTest.of(robot[poses], camera[images])).passes and test.share > 2 * TOGETHER * 0.9:
            return shift
    return None


def others_agree(way: _Way) -> IntArray | None:
    """The images that do not agree with most, if they agree with each other: something moved, or of two boards."""
    others = np.flatnonzero(~way.test.agree)
    if len(others) < LEAST_GROUP or not (test := TurnTest.of(way.robot[others], way.board[others])).passes:
        return None
    return others if test.share >= AGREES else None


# Images of a group that agrees in itself, at least.
LEAST_GROUP = 5
# Images at which many forms are compared.
COMPARED = 100
# The rest of the positions over their spread above which they do not fit, and by how much another way must be better.
MISFIT, NO_FIT, BETTER = 0.1, 0.5, 4.0
# Another size of the board is refused, or said, from these shares and standard deviations on.
REFUSED_SIZE, SAID_SIZE = (0.05, 5.0), (0.003, 3.0)
SAID_DEPTH = (0.01, 4.0)
# Where positions miss each other by more than this share of their spread, as on printed arms, errors of the arm look
# like a size or a depth of up to so many times that share.
MISSED = (0.03, 2.0)
# Distances of a board from a camera [mm]: of nearer and farther ones the unit is wrong.
NEAREST_MM, FARTHEST_MM = 5.0, 5e4
LEAST_IMAGES = 4
# Standard uncertainty of the size of an arm as it is drawn [1].
LENGTHS = 0.001
WAYS = ("as stated", "inverted", "board transposed", "robot transposed", "mirrored")
TRANSPOSED = "the rotations of the {} are transposed (columns were read as rows)"


@dataclass(frozen=True)
class Remedies:
    """What a person may do about poses of a board, by where they come from.

    Attributes
    ----------
    paired : str
        Where robot and camera turn differently.
    removed : str
        Where some images contradict the others.
    of_others : bool
        Whether others computed the poses: they may be inverted, and no fit finds the size of the board.
    mounts : (str, str)
        Where the camera is on the flange instead, and where it stands.
    size_of : str
        Of what the size that does not fit is.
    sized : str
        Where the board has another size, with ``{size}``.
    apart : str
        Where camera or board moved.
    mirrored : (str, str)
        What is mirrored where robot or camera are, and its remedy.
    """

    paired: str
    removed: str
    apart: str
    mirrored: tuple[str, str]
    of_others: bool
    mounts: tuple[str, str]
    size_of: str
    sized: str


PAIRED = "check that rows and images are of the same poses, in the same order, with the arm at rest"
MEASURE = "measure the squares of the board"
IS_FIXED = "is the board fixed, and the tool of the robot's poses always the same?"
NOT_AGAIN = "Images could not be judged again by the zeros found: {}; those ignored stay so."
# Poses that others computed, and poses by corners in images.
OF_POSES = Remedies(
    paired=f"{PAIRED}, and that the poses are by intrinsics of these images",
    removed="remove these rows",
    apart="give the images before and after it apart",
    mirrored=("one axis of the robot's poses, or the images, are mirrored", "turn the sign of that axis"),
    of_others=True,
    mounts=("--eye-in-hand", "--no-eye-in-hand"),
    size_of="the size that its poses have",
    sized=f"{MEASURE}; --board-size {{size}} corrects the poses",
)
OF_IMAGES = Remedies(
    paired=f"{PAIRED}, and that it is this arm",
    removed="remove the rows of these images from the table of pixels",
    apart="fit the images before and after it apart",
    mirrored=("the images are mirrored", "u_px to the right and v_px down, in images as the sensor takes them"),
    of_others=False,
    mounts=("--eye-in-hand", "omit --eye-in-hand, or the camera's --on-flange"),
    size_of="its stated size",
    sized=f"{MEASURE}, and state their side in --board; or it is another arm",
)


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Poses that belong together.

    Attributes
    ----------
    rows : (n,) int array
        The images whose turns agree.
    A, C : (n, 4, 4) array
        As in `truearm.wings.camera.closed_form`, translations in mm.
    test : TurnTest
        Of all images.
    start : ClosedForm
    sentences : tuple of str
        What a person must know of it.
    """

    rows: IntArray
    A: FloatArray
    C: FloatArray
    test: TurnTest
    start: ClosedForm
    sentences: tuple[str, ...]

    @property
    def turn_deg(self) -> float:
        """Root mean square difference of the turns of robot and camera, of the images that agree."""
        return self.test.rms_deg


@dataclass(frozen=True, eq=False)
class _Way:
    """The poses in a form of each, and how the turns agree."""

    robot_form: str
    board_form: str
    robot: Rotation
    board: Rotation
    test: TurnTest

    @classmethod
    def stated(cls, robot: Poses, board: Poses) -> _Way:
        """In the forms that are stated, or else the first."""
        of_robot, of_board = (one.form or next(iter(one.forms)) for one in (robot, board))
        R, C = robot.forms[of_robot], board.forms[of_board]
        return cls(of_robot, of_board, R, C, TurnTest.of(R, C))

    @property
    def forms(self) -> tuple[str, str]:
        """Of robot and board."""
        return self.robot_form, self.board_form

    def fits(self, robot_mm: FloatArray, board_mm: FloatArray, eye_in_hand: bool) -> Iterator[tuple[str, ClosedForm]]:
        """The closed form of each of `WAYS`."""
        for way in WAYS:
            A, C = self.motions(robot_mm, board_mm, eye_in_hand, way)
            yield way, closed_form(A[self.test.agree], C[self.test.agree], sized=True)

    def motions(
        self, robot_mm: FloatArray, board_mm: FloatArray, eye_in_hand: bool, way: str = WAYS[0]
    ) -> tuple[FloatArray, FloatArray]:
        """A and C."""
        R_robot = self.robot.inv() if way == "robot transposed" else self.robot
        R_board = self.board.inv() if way == "board transposed" else self.board
        # A mirror of all axes turns every rotation into itself; those of one axis are that and half a turn.
        F = motion(R_robot.as_matrix(), -robot_mm if way == "mirrored" else robot_mm)
        return inverse(F) if eye_in_hand != (way == "inverted") else F, motion(R_board.as_matrix(), board_mm)


def interpret(
    robot: Poses,
    board: Poses,
    *,
    eye_in_hand: bool,
    called: Callable[[int], str],
    board_size: float = 1.0,
    remedies: Remedies = OF_POSES,
) -> Interpretation:
    """The meaning of poses, with their forms as stated where they are.

    Parameters
    ----------
    robot, board : Poses
        Of the flange in the base, of the board in the camera, as many.
    eye_in_hand : bool
        Whether the camera is on the flange.
    called : callable
        Names an image by its row.
    board_size : float
        True size of the board over the one with which its poses were computed.
    remedies : Remedies
        What messages say to do.

    Raises
    ------
    InputError
        If the numbers are no rotations, mean several, or turn about parallel axes.
    Contradiction
        If robot and camera turn differently, the camera is elsewhere, the poses are inverted, or the board has another
        size.
    """
    robot_mm, board_mm = _positions_mm(robot, "robot"), board_size * _positions_mm(board, "board")
    if (n := len(board_mm)) < LEAST_IMAGES:
        raise InputError(f"expected {LEAST_IMAGES} images or more, got {n}", hint="25 or more, well turned")
    ways = _ways(robot, board, board_mm, called, remedies)
    _check_turning(ways[0].motions(robot_mm, board_mm, eye_in_hand)[0][ways[0].test.agree], eye_in_hand)
    found = [(way, dict(way.fits(robot_mm, board_mm, eye_in_hand))) for way in ways]
    found.sort(key=lambda one: one[1][WAYS[0]].rms_mm)
    way, fits = found[0]
    spread = float(np.sqrt(board_mm[way.test.agree].var(axis=0).sum()))
    if not fits[WAYS[0]].rms_mm <= MISFIT * spread:
        others = [one for one in _passing(robot.forms, board.forms) if one.forms not in [w.forms for w in ways]]
        refits = [(one, dict(one.fits(robot_mm, board_mm, eye_in_hand))[WAYS[0]].rms_mm) for one in others]
        _refuse_misfit([one[1] for one in found], _forms_named(refits, robot, board), spread, eye_in_hand, remedies)
    sentences = []
    asked = [(of, one, form) for of, one, form in (("board", board, way.board_form), ("robot", robot, way.robot_form))
             if one.form is None and len(one.forms) > 1]  # fmt: skip
    if asked:
        if len(found) > 1 and found[1][1][WAYS[0]].rms_mm < 2 * fits[WAYS[0]].rms_mm + 1e-6:
            raise InputError(
                f"the rotations may be {described(way.board_form)} or {described(found[1][0].board_form)}",
                hint=f"state it: --rotation {way.board_form} or {found[1][0].board_form}",
            )
        sentences += [
            f"The rotations of the {of} are read as {described(form)}: of {len(one.forms)} forms the only one in which "
            "turns and positions agree."
            for of, one, form in asked
        ]
    sentences += _wrong(way, board_mm, called, remedies)
    agree, start = way.test.agree, fits[WAYS[0]]
    A, C = (one[agree] for one in way.motions(robot_mm, board_mm, eye_in_hand))
    sentences += [*_size(start, spread, remedies), *_view(C)]
    if not NEAREST_MM < (away := float(np.median(np.linalg.norm(board_mm, axis=1)))) < FARTHEST_MM:
        taken = "m were taken for mm" if away < NEAREST_MM else "mm were taken for m"
        said = f"the board is {away:.3g} mm from the camera, as if {taken}"
        contradict(InputError(said, hint="check the unit of these positions, and of the robot's"))
    start = closed_form(A, C, sized=False)
    return Interpretation(np.flatnonzero(agree), A, C, way.test, start, tuple(sentences))


def all_together(robot: Poses, board: Poses, *, in_hand: bool, board_size: float) -> Interpretation:
    """Poses as they are stated, whether they contradict each other or not."""
    way = _Way.stated(robot, board)
    A, C = way.motions(_positions_mm(robot, "robot"), board_size * _positions_mm(board, "board"), in_hand)
    return Interpretation(np.arange(len(A)), A, C, way.test, closed_form(A, C, sized=False), ())


def _positions_mm(poses: Poses, of: str) -> FloatArray:
    if poses.unit is None:
        option = "--unit" if of == "board" else "--robot-unit"
        hint = f"{option} mm or {option} m{'; joints have names, q1_deg or q1_rad' * (of == 'robot')}"
        raise InputError(f"the unit of the positions of the {of} is not stated", hint=hint)
    return poses.positions * FACTOR[poses.unit]


def _ways(
    robot: Poses, board: Poses, board_mm: FloatArray, called: Callable[[int], str], remedies: Remedies
) -> list[_Way]:
    """The ways to read the rotations in which the turns agree, as stated if they do."""
    for poses, of in ((robot, "robot"), (board, "board")):
        if not poses.forms or (poses.form is not None and poses.form not in poses.forms):
            form = f" as {described(poses.form)}" if poses.form else ""
            hint = "--rotation FORM states them; a position comes before its rotation; left-handed frames have none"
            raise InputError(f"the rotations of the {of} are no rotations{form}", hint=hint)
    stated = [{one.form: one.forms[one.form]} if one.form else one.forms for one in (robot, board)]
    if found := _passing(*stated):
        return found
    way = _Way.stated(robot, board)
    problem = (
        f"robot and camera turn differently: {way.test.agree.sum()} of {len(way.test.agree)} images agree with each "
        "other"
    )
    if other := _passing(robot.forms, board.forms):
        words, options = _named(other[0], robot, board)
        contradict(InputError(f"{problem}; read as {words} they agree", hint=options))
        return other
    if (shift := shifted(way.robot, way.board)) is not None:
        problem += f"; with the images {number_of(abs(shift), 'row')} {'earlier' if shift > 0 else 'later'} they agree"
        alone, missing = ("image", "pose") if shift > 0 else ("pose", "image")
        ends = f"the first {alone} has" if abs(shift) == 1 else f"the first {abs(shift)} {alone}s have"
        raise InputError(problem, hint=f"pair each pose with its own image: {ends} no {missing}")
    if all("turned" in what for what in wrong_rows(way.test, way.robot, way.board, board_mm)):
        _wrong(way, board_mm, called, remedies)
        return [way]
    hint = remedies.paired
    if (others := others_agree(way)) is not None:
        steps = np.flatnonzero(np.diff(way.test.agree.astype(int)))
        if len(steps) == 1:
            problem += f"; those up to {called(int(steps[0]))} do, and those from {called(int(steps[0]) + 1)}"
            hint = f"the camera or the board moved in between, or the tool changed: {remedies.apart}"
        else:
            problem += f", and so do the others: {', '.join(map(called, others.tolist()))}"
            hint = "are there two boards, or two places of one? Keep their images apart"
    contradict(InputError(problem, hint=hint))
    return [replace(way, test=TurnTest.of(way.robot, way.board, all_right=True))]  # accepted


def _named(way: _Way, robot: Poses, board: Poses) -> tuple[str, str]:
    """Forms that differ from what is stated, in words and as options."""
    of = (("--rotation", way.board_form, board.form), ("--robot-rotation", way.robot_form, robot.form))
    differ = [(described(form), f"{option} {form}") for option, form, now in of if form != now]
    return " and ".join(words for words, _ in differ), " ".join(option for _, option in differ)


def _passing(robot: dict[str, Rotation], board: dict[str, Rotation]) -> list[_Way]:
    """All pairs of forms in which most images agree, without those that agree far worse than the best."""
    n = len(next(iter(robot.values())))
    some = np.linspace(0, n - 1, min(n, COMPARED)).round().astype(int)
    upper = np.triu_indices(len(some), 1)
    turned = [{form: turns(R[some])[upper] for form, R in side.items()} for side in (robot, board)]
    found = []
    for one, a in turned[0].items():
        for two, c in turned[1].items():
            if np.quantile(np.abs(a - c), 0.3) < MOST_DEG:
                test = TurnTest.of(robot[one], board[two])
                if test.passes:
                    found.append(_Way(one, two, robot[one], board[two], test))
    best = max((way.test.share for way in found), default=0.0)
    found = [way for way in found if way.test.share > 0.9 * best]
    least = min((way.test.rms_deg for way in found), default=0.0)
    return [way for way in found if way.test.rms_deg < 2 * least + 0.1]


def _wrong(way: _Way, board_mm: FloatArray, called: Callable[[int], str], remedies: Remedies) -> list[str]:
    """What is wrong with the images that do not agree; many are refused."""
    test, n = way.test, len(way.test.agree)
    if test.agree.all():
        return []
    named = wrong_rows(test, way.robot, way.board, board_mm)
    listed = "; ".join(f"{what}: {', '.join(map(called, rows))}" for what, rows in named.items())
    left = number_of(n - int(test.agree.sum()), "image")
    if 1 - test.share > FEW_WRONG:
        hint = f"pair these images with their own poses, or {remedies.removed}"
        if all("turned" in what for what in named):
            hint = f"{remedies.removed}, or use a ChArUco board: half a turn does not map it onto itself"
        contradict(InputError(f"{left} of {n} contradict the others: {listed}", hint=hint))
    return [f"Ignored, as robot and camera turn differently: {left} of {n}. {listed[0].upper()}{listed[1:]}."]


def _forms_named(refits: list[tuple[_Way, float]], robot: Poses, board: Poses) -> list[tuple[float, str, str]]:
    """The positions' rest in other forms that turn alike, with words and options."""
    return [(rms, f"it is {rms:.3g} mm with {words}", options) for way, rms in refits
            for words, options in (_named(way, robot, board),)]  # fmt: skip


def _refuse_misfit(
    found: list[dict[str, ClosedForm]],
    others: list[tuple[float, str, str]],
    spread: float,
    eye_in_hand: bool,
    remedies: Remedies,
) -> None:
    """Refuse poses whose positions fit another way, or none."""
    rms = found[0][WAYS[0]].rms_mm
    where, elsewhere = "beside the robot", "on the flange"
    if eye_in_hand:
        where, elsewhere = elsewhere, where
    misses = f"the positions miss each other by {rms:.3g} mm" if np.isfinite(rms) else "the positions do not fit"
    misses += f" with the camera {where}"
    best = {way: min(fits[way].rms_mm for fits in found) for way in WAYS[1:]}
    left = best["inverted"]
    words, hint = f"with the camera {elsewhere} it is {left:.3g} mm", remedies.mounts[eye_in_hand]
    if remedies.of_others:
        words += f". If the camera is {where}, the poses of robot or board are inverted"
        hint += ", or --invert board (or robot)"
    named = [(left, words, hint)]
    for of in ("board", "robot"):
        left = best[f"{of} transposed"]
        named.append((left, f"it is {left:.3g} mm if {TRANSPOSED.format(of)}", "transpose the matrices"))
    named.append((best["mirrored"], f"it is {best['mirrored']:.3g} mm if {remedies.mirrored[0]}", remedies.mirrored[1]))
    left, words, hint = min([*named, *others])
    if left < min(rms / BETTER, NO_FIT * spread):
        contradict(InputError(f"{misses}; {words}", hint=hint))
    elif not rms <= NO_FIT * spread:
        contradict(InputError(f"{misses}, though the turns agree", hint=IS_FIXED))


def _check_turning(A: FloatArray, eye_in_hand: bool) -> None:
    """Refuse poses that turn about one axis: the position along it is open."""
    parallel = Parallel.of(A)
    if parallel.is_open:
        axis = ", ".join(f"{one:.2f}" for one in parallel.axis)
        frame, what = ("flange", "camera") if eye_in_hand else ("base", "camera")
        other = "board in the base" if eye_in_hand else "board on the flange"
        raise InputError(
            f"all poses turn about one axis, ({axis}) of the {frame}, and by {np.degrees(parallel.turning):.1f} deg "
            f"about others: where the {what} is along it is not determined, only with the {other} together",
            hint="turn the flange about a second axis, by 30 deg or more; an arm of four axes cannot",
        )


def _size(start: ClosedForm, spread: float, remedies: Remedies) -> list[str]:
    """What positions say of the board's size and of the focal length; a fit of images finds both itself."""
    off, std, missed = abs(start.size - 1), max(start.size_std, 1e-12), start.rms_mm / spread
    least = MISSED[1] * missed if missed > MISSED[0] else 0.0
    if missed > MISFIT:
        return []
    u = f"{start.size:.4g} (u {start.size_std:.1g})"
    if is_refused := off > max(REFUSED_SIZE[0], REFUSED_SIZE[1] * std, least):
        factor = next((one for one in (1e3, 1e-3) if abs(start.size / one - 1) < 0.2), None)
        unit = "" if factor is None else ": mm taken for m, or m for mm"
        hint = remedies.sized.format(size=f"{factor or start.size:.4g}")
        contradict(InputError(f"the board is {u} times {remedies.size_of}{unit}", hint=hint))
    if not remedies.of_others:
        return []
    sentences = []
    if not is_refused and off > max(SAID_SIZE[0], SAID_SIZE[1] * float(np.hypot(std, LENGTHS)), least):
        sentences.append(
            f"The arm's lengths say that the board is {u} times as large as its poses have it: measure its squares."
        )
    if abs(start.depth - 1) > max(SAID_DEPTH[0], SAID_DEPTH[1] * start.depth_std, least):
        sentences.append(
            f"Distances along the camera's axis are {start.depth:.4g} (u {start.depth_std:.1g}) of those across it: "
            "the focal length is wrong, or of another resolution."
        )
    return sentences


def _view(C: FloatArray) -> list[str]:
    """Whether the board is seen in front of a camera."""
    t = C[:, :3, 3]
    mean = (t / np.linalg.norm(t, axis=1)[:, None]).mean(axis=0)
    axis = int(np.abs(mean).argmax())
    if axis == 2 and mean[2] > 0:
        return []
    along = f"{'-' * int(mean[axis] < 0)}{'xyz'[axis]}"
    seen = f"The board is seen along the {along} axis of the camera's frame, not along z: "
    if axis == 0 and mean[0] > 0:
        return [seen + "the frame is a camera_link of ROS, not an optical frame. The transforms are of that frame."]
    return [seen + "the frame is no optical frame, or the poses are inverted."]
