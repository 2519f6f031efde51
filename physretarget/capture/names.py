"""Joint names of many capture systems, read as parts of one human body.

``recognise`` answers with an index per *role*; roles are the joints that the actor needs::

    hips  spine (list)  chest  neck  head
    left_/right_ + clavicle upper_arm forearm hand finger thigh shank foot toe

A joint is named after the segment that it moves: ``left_shank`` is the knee joint.
Case, separators, namespaces and character prefixes don't matter; what a name leaves open
("LeftShoulder" is a collar bone in one system and the upper arm in another) is decided by what
else is in the chain.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from physretarget.capture.languages import in_english

SIDES = ("left", "right")
ROLES = (
    "hips", "neck", "head",
    *(
        f"{side}_{part}"
        for side in SIDES
        for part in ("clavicle", "upper_arm", "forearm", "hand", "finger", "thigh", "shank",
                     "foot", "toe")
    ),
)  # fmt: skip
"""Roles that a name alone can give."""

_SIDE_TOKENS = {
    "left": "left", "l": "left", "lft": "left", "lt": "left",
    "links": "left", "gauche": "left",
    "right": "right", "r": "right", "rgt": "right", "rt": "right",
    "rechts": "right", "droite": "right",
}  # fmt: skip

# Per limb joint: names without side, in order of preference.
_LIMBS: dict[str, tuple[str, ...]] = {
    "thigh": ("thigh", "upleg", "upperleg", "femur", "thighbend", "legupper", "uplegbend",
              "upperlegbend", "hip", "legup", "hips", "leg1", "hipjoint", "leg"),
    "shank": ("shank", "shin", "knee", "lowerleg", "lowleg", "tibia", "calf", "leglower",
              "crus", "leglow", "shinbend", "leg2", "leg"),
    "foot": ("ankle", "foot", "feet", "talus", "leg3", "talocrural"),
    "toe": ("toe", "toes", "toebase", "toe0", "toe1", "toe01", "toe11", "ball", "toejoint",
            "foottoe",
            "toebase0", "footindex", "bigtoe", "forefoot", "toesend", "toeend", "foot"),
    "clavicle": ("clavicle", "collar", "scapula", "collarbone", "shoulderblade", "claviclebase",
                 "collarjoint", "clav", "shoulder", "shldr", "shoulder0", "shoulder1"),
    "upper_arm": ("upperarm", "uparm", "humerus", "arm", "armupper", "shldrbend", "shoulder",
                  "shldr", "armup", "bicep", "glenohumeral", "arm1", "upperarmbend", "uarm"),
    "forearm": ("forearm", "lowerarm", "lowarm", "elbow", "radius", "ulna", "armlower", "loarm",
                "forearmbend", "armlow", "arm2", "radioulnar", "farm", "larm"),
    "hand": ("wrist", "hand", "palm", "carpus", "arm3"),
    "finger": ("handmiddle1", "middle1", "middle01", "handmiddle", "fingers", "finger", "index1",
               "handindex1", "index01", "fingerbase", "finger2", "finger0", "finger1", "hand1",
               "middle", "index", "mid1", "fmiddle1", "handtip", "knuckle"),
}  # fmt: skip

_NECK = ("neck", "neck1", "neck0", "neck01", "lowerneck", "necklower", "neckbase", "spineneck")
_HEAD = ("head", "skull", "face", "upperhead", "head1", "cranium")
_HIPS = ("hips", "hip", "pelvis", "root", "bodyroot", "waist", "cog", "jointroot")
# Words that say "this is a joint" and no more; but CMU's "LHipJoint" is a helper, no hip joint.
_FILLERS = {
    "joint",
    "jnt",
    "jt",
    "bone",
    "bnd",
    "bind",
    "def",
    "org",
    "stretch",
    "deform",
    "x",
    "c",
    "m",  # Advanced Skeleton's "Head_M": in the middle
}
# Helpers that carry a body part's name and are no joint of it.
_NOISE = re.compile(
    r"twist|roll(?!l)|nub|ik$|^ik|pole|target|helper|ctrl|control|effector|dummy|volume|muscle"
    r"|pectoral|breast|jaw|eye|hair|tail|skirt|cloth|prop|weapon|socket|footsteps"
)


@dataclass(frozen=True)
class Body:
    """Which joint plays which role (``role -> joint index``), and the spine between."""

    roles: Mapping[str, int]
    spine: tuple[int, ...]  # joints strictly between hips and neck, hips' side first

    def missing(self, wanted: Iterable[str]) -> tuple[str, ...]:
        """The roles among ``wanted`` that no joint plays."""
        return tuple(role for role in wanted if role not in self.roles)


def split_name(name: str) -> tuple[str | None, tuple[str, ...]]:
    """Side ("left", "right" or None) and the remaining lower-case tokens of a joint's name."""
    name = in_english(re.split(r"[:|]", name)[-1])
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    spaced = re.sub(r"([A-Z])([A-Z][a-z])", r"\1 \2", spaced)
    tokens = [token for token in re.split(r"[^a-z0-9]+", spaced.lower()) if token]
    side = None
    kept = []
    for token in tokens:
        found = _SIDE_TOKENS.get(token)
        if found and side is None:
            side = found
        else:
            kept.append(token)
    if side is None:
        side, kept = _glued_side(kept)
    for start in range(len(kept) - 1 if side is None else 0):  # "Bob_LUArm" reads as "Bob LU Arm"
        side, whole = _glued_side(["".join(kept[start:])])
        if side:
            kept = [*kept[:start], *whole]
            break
    plain = [token for token in kept if token not in _FILLERS]
    return side, tuple(plain if plain and plain != ["hip"] else kept)


def _glued_side(tokens: list[str]) -> tuple[str | None, list[str]]:
    """A side written without a separator: ``lfemur``, ``leftupleg``, ``footr``."""
    vocabulary = {alias for aliases in _LIMBS.values() for alias in aliases} | {"hipjoint"}
    for at, token in enumerate(tokens):
        for mark in ("left", "right", "l", "r"):
            rest = None
            if token.startswith(mark) and token[len(mark) :] in vocabulary:
                rest = token[len(mark) :]
            elif token.endswith(mark) and token[: -len(mark)] in vocabulary:
                rest = token[: -len(mark)]
            if rest is not None:
                return _SIDE_TOKENS[mark], [*tokens[:at], rest, *tokens[at + 1 :]]
    return None, tokens


def _spellings(tokens: Sequence[str]) -> list[str]:
    """What a name may mean: all tokens joined, then with leading (prefix) tokens dropped."""
    joined = ["".join(tokens[start:]) for start in range(len(tokens))]
    plain = [re.sub(r"^0+|(?<=\D)0+(?=\d)", "", word) for word in joined]
    bare = [re.sub(r"0\d$", "", word) for word in joined]  # "upperleg01" is the first of two
    return list(dict.fromkeys(word for word in [*joined, *plain, *bare] if word))


def ancestors(parents: Sequence[int], joint: int) -> list[int]:
    """The chain from ``joint`` (first) to its root (last)."""
    chain = []
    while joint >= 0:
        chain.append(joint)
        joint = parents[joint]
    return chain


def _candidates(
    words: Sequence[list[str]], allowed: Sequence[int], aliases: Sequence[str]
) -> list[int]:
    """Joints named by any alias; the best alias first, then nearest the root."""
    found = []
    for alias in aliases:
        found += [j for j in allowed if alias in words[j] and j not in found]
    return found


def _below(parents: Sequence[int], joint: int, above: int) -> bool:
    return joint != above and above in ancestors(parents, joint)


def _limb(
    chain: Sequence[str],
    words: Sequence[list[str]],
    allowed: Sequence[int],
    parents: Sequence[int] | None,
    side: str,
) -> dict[str, int]:
    """Assign the joints of one limb so that each lies below the one before it.

    Without ``parents`` the names alone decide.
    """
    best: dict[str, int] = {}

    def extend(at: int, chosen: dict[str, int]) -> None:
        nonlocal best
        if at == len(chain):
            if _limb_score(chosen, best):
                best = dict(chosen)
            return
        last = next((chosen[r] for r in reversed(chain[:at]) if r in chosen), None)
        options = [
            j
            for j in _candidates(words, allowed, _LIMBS[chain[at]])
            if j not in chosen.values()
            and (last is None or parents is None or _below(parents, j, last))
        ]
        for j in options[:4]:
            extend(at + 1, {**chosen, chain[at]: j})
        extend(at + 1, chosen)

    extend(0, {})
    return {f"{side}_{role}": joint for role, joint in best.items()}


def _completed(
    limb: dict[str, int], chain: Sequence[str], parents: Sequence[int], side: str
) -> dict[str, int]:
    """Fill a limb's unnamed joints by structure: an only child continues its parent's chain."""
    for above, part in pairwise(chain):
        start = limb.get(f"{side}_{above}")
        if start is None or f"{side}_{part}" in limb:
            continue
        children = [j for j, parent in enumerate(parents) if parent == start]
        if len(children) == 1 and children[0] not in limb.values():
            limb[f"{side}_{part}"] = children[0]
    return limb


def _limb_score(new: Mapping[str, int], old: Mapping[str, int]) -> bool:
    """Whether ``new`` explains the limb better: its three main joints first, then more joints."""
    main = {"thigh", "shank", "foot", "upper_arm", "forearm", "hand"}
    return (len(main & new.keys()), len(new)) > (len(main & old.keys()), len(old))


def _common(parents: Sequence[int], a: int, b: int) -> int | None:
    above = set(ancestors(parents, b))
    return next((j for j in ancestors(parents, a) if j in above), None)


def recognise(names: Sequence[str], parents: Sequence[int]) -> Body:
    """Find the body's joints by name, checked by parent relations; see the module's text."""
    split = [split_name(name) for name in names]
    words = [_spellings(tokens) for _, tokens in split]
    usable = [j for j in range(len(names)) if not _NOISE.search("".join(split[j][1]))]
    roles: dict[str, int] = {}
    for side in SIDES:
        allowed = [j for j in usable if split[j][0] == side]
        leg = _limb(("thigh", "shank", "foot", "toe"), words, allowed, parents, side)
        roles |= _completed(leg, ("thigh", "shank", "foot"), parents, side)
        arm = _limb(
            ("clavicle", "upper_arm", "forearm", "hand", "finger"), words, allowed, parents, side
        )
        arm = _acclaim_wrist(arm, names, parents, side)
        roles |= _completed(arm, ("upper_arm", "forearm", "hand"), parents, side)
    central = [j for j in usable if split[j][0] is None]
    return _trunk(roles, words, central, parents)


def recognise_centres(names: Sequence[str]) -> dict[str, int]:
    """Roles (``role -> index``) of joint centres that come without a hierarchy.

    Some systems export the joints' positions as if they were markers (Shadow, Kinect, Theia).
    """
    split = [split_name(name) for name in names]
    words = [_spellings(tokens) for _, tokens in split]
    roles: dict[str, int] = {}
    for side in SIDES:
        allowed = [j for j in range(len(names)) if split[j][0] == side]
        for chain in (
            ("thigh", "shank", "foot", "toe"),
            ("clavicle", "upper_arm", "forearm", "hand", "finger"),
        ):
            roles |= _limb(chain, words, allowed, None, side)
    central = [j for j in range(len(names)) if split[j][0] is None]
    for role, aliases in (("hips", (*_HIPS, "spinebase")), ("neck", _NECK), ("head", _HEAD)):
        found = _candidates(words, central, aliases)
        if found:
            roles[role] = found[0]
    return roles


def _acclaim_wrist(
    arm: dict[str, int], names: Sequence[str], parents: Sequence[int], side: str
) -> dict[str, int]:
    """Acclaim's "lwrist" bone is the far third of the forearm; the hand starts with "lhand"."""
    hand = arm.get(f"{side}_hand")
    if hand is None or names[hand].lower() != f"{side[0]}wrist":
        return arm
    parent = parents[hand]
    if parent < 0 or names[parent].lower() != f"{side[0]}radius":
        return arm
    for j, name in enumerate(names):
        if name.lower() == f"{side[0]}hand" and parents[j] == hand:
            arm[f"{side}_hand"] = j
            break
    return arm


def _trunk(
    roles: dict[str, int],
    words: Sequence[list[str]],
    central: Sequence[int],
    parents: Sequence[int],
) -> Body:
    """Hips carry both thighs, the chest carries both arms: found by structure, not by name."""
    hips = None
    if "left_thigh" in roles and "right_thigh" in roles:
        hips = _common(parents, roles["left_thigh"], roles["right_thigh"])
    if hips is None:
        hips = next(iter(_candidates(words, central, _HIPS)), None)
    if hips is None:
        return Body(roles, ())
    roles["hips"] = hips
    head = next(iter(_candidates(words, central, _HEAD)), None)
    neck = next((j for j in _candidates(words, central, _NECK) if j != head), None)
    chest = None
    arms = [roles.get(f"{side}_clavicle", roles.get(f"{side}_upper_arm", -1)) for side in SIDES]
    if min(arms) >= 0:
        chest = _common(parents, arms[0], arms[1])
    if neck is None and head is None and chest is not None:
        neck, head = _head_by_structure(parents, chest, central, roles)
    if neck is None and head is not None:
        neck = _neck_by_structure(parents, head, chest, hips)
    if neck is not None and head is None:
        below = [j for j in central if _below(parents, j, neck)]
        head = below[-1] if below else None
    if chest is None and neck is not None:
        chest = parents[neck] if parents[neck] >= 0 else None
    for role, joint in (("head", head), ("neck", neck), ("chest", chest)):
        if joint is not None:
            roles[role] = joint
    return Body(roles, _spine(roles, parents))


def _neck_by_structure(
    parents: Sequence[int], head: int, chest: int | None, hips: int
) -> int | None:
    chain = ancestors(parents, head)
    stop = chest if chest in chain else hips
    between = chain[1 : chain.index(stop)] if stop in chain else []
    return between[-1] if between else None


def _head_by_structure(
    parents: Sequence[int], chest: int, central: Sequence[int], roles: Mapping[str, int]
) -> tuple[int | None, int | None]:
    """Neck and head where no name tells: the chain without a side that leaves the chest.

    Blender's Rigify counts its spine up to the head: ``spine.003`` carries the arms.
    """
    taken = {above for joint in roles.values() for above in ancestors(parents, joint)}
    chain: list[int] = []
    at = chest
    while True:
        onward = [j for j in central if parents[j] == at and j not in taken]
        if len(onward) != 1:
            break
        at = onward[0]
        chain.append(at)
    return (chain[0], chain[-1]) if len(chain) > 1 else (None, chain[0] if chain else None)


def _spine(roles: Mapping[str, int], parents: Sequence[int]) -> tuple[int, ...]:
    """Joints below the hips on the way to the chest, the chest included."""
    top = roles.get("chest", roles.get("neck", roles.get("head")))
    if top is None or top == roles["hips"]:
        return ()
    chain = ancestors(parents, top)
    if roles["hips"] in chain:
        chain = chain[: chain.index(roles["hips"])]
    return tuple(reversed(chain))
