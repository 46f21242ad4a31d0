"""Base and tip of a URDF: the links between which its arm is, as far as the file shows them.

The arm is the longest chain of moving joints. Its tip is a link that is fixed to its last moving link; of several the
names decide that public collections use. Fingers of a gripper are no part of the arm: what carries them is its tip.
So it is where an arm divides that has as many joints before as any branch after: the branches are those of a hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from truearm.arm.urdf_tree import MOVING, UrdfJoint, UrdfTree, named
from truearm.errors import InputError

# Usual names of a tip, the first that fits: behind the name of a robot or a side, before "link" or "frame".
TIP_NAMES = (
    ("tool0", r"tool_?0"),
    ("flange", r"flange"),
    ("ee_link", r"ee|eef|link_ee"),
    ("tcp", r"tcp|tool_center_point|tool|tooltip|tip"),
    ("end_effector", r"end_?effector(_tip)?"),
    ("gripper base", r"(gripper|hand)(_base|_body|_palm)?|palm"),
)
_USUAL = [re.compile(rf"(.*_)?({form})(_link|_frame)?") for _, form in TIP_NAMES]
_FINGER = re.compile("finger|knuckle|jaw|thumb|claw")
# Every other chain of moving joints has at most this part of the joints of the arm.
_OTHER_CHAINS = 0.5


class Ends(NamedTuple):
    """The links between which an arm is, and in words what was chosen of what; no words where there was no choice."""

    base: str
    tip: str
    remark: str = ""


def find_ends(tree: UrdfTree, base: str | None = None, tip: str | None = None) -> Ends:
    """Find the links between which the arm of a URDF is: those asked for, else those that the file states itself.

    Raises
    ------
    InputError
        If there is no such link, the joints form a loop, nothing moves, or several arms are equally long.
    """
    base, tip = base or tree.stated_ends[0], tip or tree.stated_ends[1]
    for link in (base, tip):
        if link is not None and link not in tree.links:
            raise InputError(f"there is no link {link!r}", hint=f"use one of {named(list(tree.links))}")
    if tip is not None:
        return Ends(tree.standing_link_above(tip) if base is None else base, tip)
    if not tree.links or not tree.joints:
        raise InputError(f"the robot has no <{'joint' if tree.links else 'link'}>")
    if base is not None:
        return _Branches(tree, [base]).ends([base])
    roots = [link for link in tree.links if link not in tree.joint_above]
    if not roots:
        raise InputError("no link can be the base: the joints form a loop")
    # What a floating or planar joint carries stands as far as the arm is concerned.
    carried = [joint.child for joint in tree.joints if joint.kind in ("floating", "planar")]
    branches = _Branches(tree, roots)
    moving = [link for link in (*roots, *carried) if branches.depth.get(link)] or roots
    return branches.ends(moving)


class _Branches:
    """How many joints deep an arm hangs below each link, without the fingers of grippers."""

    def __init__(self, tree: UrdfTree, roots: list[str]) -> None:
        self.below: dict[str, list[UrdfJoint]] = {link: [] for link in tree.links}
        for joint in tree.joints:
            self.below[joint.parent].append(joint)
        self.depth: dict[str, int] = {}
        self.fingers: set[str] = set()
        for link in reversed(list(self._walk(roots))):
            last = (joint for joint in self.below[link] if joint.kind in MOVING and not self.depth[joint.child])
            self.fingers |= {joint.name for joint in last if _is_named_finger(joint)}
            self.depth[link] = max([0, *map(self.length, self.below[link])])

    def _walk(self, roots: list[str]) -> Iterator[str]:
        """Yield all links below some, every one after the link that carries it."""
        waiting = roots[::-1]
        while waiting:
            yield (link := waiting.pop())
            waiting += [joint.child for joint in reversed(self.below[link])]

    def length(self, joint: UrdfJoint) -> int:
        """Number of moving joints in a row from a joint on."""
        if joint.kind in ("floating", "planar"):
            return 0
        return self.depth[joint.child] + (joint.kind in MOVING and joint.name not in self.fingers)

    def ends(self, bases: list[str]) -> Ends:
        """The longest chain from one of some bases."""
        base = max(bases, key=lambda link: self.depth[link])
        length = self.depth[base]
        if not length:
            what = " but the fingers of a gripper" if self.fingers else ""
            raise InputError(f"there is no moving joint{what} between the base and the tip")
        rivals = [link for link in bases if link != base and self.depth[link] > _OTHER_CHAINS * length]
        if rivals:
            self._refuse(length, [self._tip(link)[0] for link in (base, *rivals)])
        tip, candidates, passed = self._tip(base)
        choice = [f"tip: {tip}, of {named(candidates)}"] if len(candidates) > 1 else []
        if passed:
            choice.append("the longest chain" if choice else f"tip: {tip}, of the longest chain")
        if any(joint.name in self.fingers for link in candidates for joint in self.below[link]):
            choice.append("without its fingers" if choice else f"tip: {tip}, which carries the fingers of a gripper")
        return Ends(base, tip, ", ".join(choice))

    def _tip(self, start: str, above: int = 0) -> tuple[str, list[str], bool]:
        """The tip of the longest chain from a link, all that it could be, and whether other chains were passed.

        Some moving joints may stand above the link.
        """
        passed, link = False, start
        while True:
            body = self._fixed_to(link)
            going = [joint for member in body for joint in self.below[member] if self._goes_on(joint)]
            if not going:
                break
            going.sort(key=self.length, reverse=True)
            rivals = [one for one in going[1:] if self.length(one) > _OTHER_CHAINS * self.length(going[0])]
            if rivals and above >= self.length(going[0]):
                self.fingers |= {joint.name for joint in going}
                break
            above += 1
            if rivals:
                self._refuse(self.length(going[0]), [self._tip(one.child, above)[0] for one in (going[0], *rivals)])
            passed, link = passed or len(going) > 1, going[0].child
        carries = [member for member in body if any(joint.name in self.fingers for joint in self.below[member])]
        ends = [member for member in body if member in carries or not self.below[member]] or [link]

        def rank(member: str) -> tuple[bool, int, bool]:
            name = re.sub(r"[\W_]+", "_", member.lower())
            usual = next((i for i, form in enumerate(_USUAL) if form.fullmatch(name)), len(_USUAL))
            return usual == len(_USUAL), usual, member not in carries

        best = min(ends, key=rank)
        if len(ends) > 1 and rank(best)[0] and best not in carries:
            best = link  # none has a usual name: the last link that moves
        return best, list(dict.fromkeys((best, *ends))), passed

    def _goes_on(self, joint: UrdfJoint) -> bool:
        return joint.kind in MOVING and joint.name not in self.fingers

    def _fixed_to(self, link: str) -> list[str]:
        """The link and all that are fixed to it."""
        body = [link]
        for member in body:  # it grows
            body += [joint.child for joint in self.below[member] if joint.kind == "fixed"]
        return body

    def _refuse(self, length: int, tips: list[str]) -> None:
        joints = f"{length} joint{'s' * (length > 1)}"
        raise InputError(
            f"{len(tips)} arms could be meant, the longest of {joints}, with the tips {named(tips)}",
            hint=f"name one after the file: FILE.urdf::{tips[0]} (FILE.urdf:BASE:TIP)",
        )


def _is_named_finger(joint: UrdfJoint) -> bool:
    """Whether a joint at the end of a chain has the name of a finger, or of a gripper that opens."""
    name, link = joint.name.lower(), joint.child.lower()
    opens = "gripper" in name and not re.search("base|palm|body|wrist|rot|roll", f"{name} {link}")
    return bool(opens or _FINGER.search(name) or _FINGER.search(link))
