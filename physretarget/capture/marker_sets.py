"""Which label means which place on the body: the marker sets in common use.

Labels are compared without case, separators, subject prefix (``male:``) and the suffix
``_study`` of OpenCap's augmenter. Known: the CMU database's 41 markers, Plug-in-Gait, Helen
Hayes and Cortex names, OpenSim and OpenCap (measured and augmented), Rizzoli/IOR and ISB
landmarks, BTS' Davis protocol, Qualisys' and OptiTrack's animation sets, joints as video sees
them (OpenPose, COCO, HALPE, MediaPipe, SMPL), and the joint centres of skeletons by any name that
:mod:`physretarget.capture.names` knows (Shadow, Kinect, LAFAN).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import PARENTS, SEGMENT, SEGMENTS, ActorShape
from physretarget.capture.names import recognise_centres
from physretarget.capture.skeleton import lies_down, upright_axis

Floats = NDArray[np.float64]

KNOWN_SETS = (
    "CMU/Vicon 41, Plug-in-Gait, Helen Hayes, Davis, OpenSim, OpenCap, Rizzoli/IOR, ISB, "
    "Qualisys, OptiTrack, OpenPose, COCO and MediaPipe key points, joint centres named as in BVH"
)
_SUBJECT = 8  # so many labels with one beginning may name a person
BONE, SKIN, CLUSTER = 0.02, 0.04, 0.10  # how far (m) a marker may sit from where it is expected

# Where each landmark is on the reference actor (1.75 m) in the zero pose: segment, world
# position in metres (the left one of a pair), how sure (m), labels. With the arms hanging the
# palms face the thighs: the radius is in front, the outside of the elbow to the side.
_MID: dict[str, tuple[str, tuple[float, float, float], float, str]] = {
    "sacrum": ("pelvis", (-0.105, 0.0, 1.015), BONE, "sacr sacrum vsacral sacral s1 mpsi waistback "
               "bwt midpsis"),
    "lumbar": ("pelvis", (-0.105, 0.0, 1.045), SKIN, "l5 lv5 l4 lv4 spinelumbar"),
    "lumbar_upper": ("abdomen", (-0.105, 0.0, 1.13), SKIN, "l3 lv3 l2 lv2 l1 lv1 mai t12 tv12 "
                     "spinethoracic12"),
    "midhip": ("pelvis", (0.0, 0.0, 0.9275), BONE, "midhip hipcenter hipcentre pelviscenter"),
    "t10": ("chest", (-0.125, 0.0, 1.26), SKIN, "t10 tv10 t9 tv9"),
    "t8": ("chest", (-0.13, 0.0, 1.32), SKIN, "t8 tv8 t7 tv7 t6 tv6 spinethoracic8 midback"),
    "t4": ("chest", (-0.12, 0.0, 1.42), SKIN, "t5 t4 t3 tv4 tv5"),
    "c7": ("chest", (-0.085, 0.0, 1.515), BONE, "c7 cv7 t1 tv1 t2 tv2 spinetop spinethoracic2 "
           "backtop vc7"),
    "clav": ("chest", (0.055, 0.0, 1.435), BONE, "clav ij snj sstn jn sternumtop suprasternal "
             "suprasternalnotch sjn uppersternum clavicle ssn strt manubrium stern"),
    "strn": ("chest", (0.10, 0.0, 1.275), BONE, "strn px sxs xiph xiphoid xyph xp lowersternum"),
    "sternum": ("chest", (0.085, 0.0, 1.36), SKIN, "sternum chest chst breast"),
    "neck": ("chest", (-0.0175, 0.0, 1.50), BONE, "neck"),
    "head_top": ("head", (0.0, 0.0, 1.755), SKIN, "ariel headtop tophead toph head vertex arie hdt "
                 "apex"),
    "head_front": ("head", (0.105, 0.0, 1.67), SKIN, "headfront fronthead frontalhead sgl glab "
                   "glabella fhd fhead forehead hdfm fronh"),
    "head_back": ("head", (-0.10, 0.0, 1.66), SKIN, "headback rearhead backhead bhd bhead "
                  "inion"),
    "nose": ("head", (0.115, 0.0, 1.62), SKIN, "nose"),
}  # fmt: skip
_SIDED: dict[str, tuple[str, tuple[float, float, float], float, str]] = {
    # pelvis
    "asis": ("pelvis", (0.070, 0.125, 1.010), BONE, "asi asis ias fwt frontwaist rasis waistfront "
             "sias"),
    "psis": ("pelvis", (-0.105, 0.050, 1.020), BONE, "psi psis ips bwt backwaist sips"),
    "iliac_crest": ("pelvis", (-0.015, 0.150, 1.060), SKIN, "ic il ilc iliac iliaccrest icr iliaccr"
                    " crest ict hip1 waist"),
    "hip_centre": ("pelvis", (0.0, 0.0875, 0.9275), BONE, "hjc hjcreg hipjointcenter hipjc "
                   "hipcentre hipcenter hiporigin"),
    # leg
    "trochanter": ("thigh", (-0.005, 0.170, 0.925), SKIN, "gt ftc gtr troc trochanter grtr grt "
                   "greatertrochanter hip trc"),
    "thigh": ("thigh", (0.01, 0.165, 0.72), CLUSTER, "thi thigh thighwand wand1 thiw tiw thigho "
              "thighwl thighrear thighside qua bar1"),
    "thigh_upper": ("thigh", (0.06, 0.14, 0.78), CLUSTER, "th1 thigh1 thi1 thighupper "
                    "thighfronthigh thi4 thigh4 th4 tha thiu tht1 t1u"),
    "thigh_front": ("thigh", (0.08, 0.11, 0.66), CLUSTER, "th2 thigh2 thi2 thighfront thighfrontlow"
                    " th3 thigh3 thi3 thigh5 th5 thigh6 thp thb thc thd tht2 tht3"),
    "knee_lateral": ("thigh", (0.0, 0.142, 0.500), BONE, "kne knee knel kneelat kneelateral le fle "
                     "lfe lfc kneeout lep lknee lek flep kneo klat lkn fcl kneeouter latknee "
                     "lateralknee lcon lfemepi lfemcondyle kneelatl knee1"),
    "knee_medial": ("thigh", (0.0, 0.040, 0.500), BONE, "knm mknee knem kneemed kneemedial me fme "
                    "mfe mfc kneein mep mek kmed medknee mkn fcm kneeinner mkne knmd medialknee "
                    "mcon mfemepi kni knee2"),
    "patella": ("thigh", (0.055, 0.0875, 0.510), SKIN, "pat patella fpa kneefront"),
    "fibula": ("shank", (-0.015, 0.140, 0.455), BONE, "fax hf fib fibula hfb fibhead fh fbh"),
    "tibial_tuberosity": ("shank", (0.050, 0.0875, 0.440), BONE, "ttc tt tub tibialtuberosity tto "
                          "tibtub"),
    "shank": ("shank", (0.02, 0.125, 0.30), CLUSTER, "tib shn shin shank shankwand wand2 tibw "
              "shankside shinwand shanklat leg tiwl tiba shinfronthigh shinfrontlow bar2"),
    "shank_upper": ("shank", (0.045, 0.10, 0.38), CLUSTER, "sh1 sk1 shank1 shankupper shankantsup "
                    "tib1 tb1 shinfront shankfront sha1 tia shk1"),
    "shank_lower": ("shank", (0.03, 0.12, 0.25), CLUSTER, "sh2 sh3 sh4 sh5 sk2 sk3 sk4 shank2 "
                    "shank3 shank4 shankrear tib2 tib3 tib4 tb2 tb3 sha2 sha3 tic tid shk2 shk3 "
                    "shk4"),
    "ankle_lateral": ("shank", (-0.005, 0.127, 0.072), BONE, "ank ankle anklelat anklelateral lm "
                      "fal lmal ankleout lank malleoluslat lma lankle latankle ankl lateralankle "
                      "lateralmalleolus lmalleolus lml att"),
    "ankle_medial": ("shank", (0.005, 0.048, 0.080), BONE, "anm mankle anklemed anklemedial mm tam "
                     "mmal anklein mma medankle ankm malleolusmed medial ank2 mank ankmd mmed "
                     "medialankle medialmalleolus mmalleolus mml ani"),
    "heel": ("foot", (-0.065, 0.0875, 0.045), BONE, "hee heel calc ca fcc cal heelback heelback1 "
             "calcaneus heel1 hl cac calca heelcen heelpost heelupper"),
    "heel_side": ("foot", (-0.045, 0.115, 0.035), SKIN, "heellat stl latheel lcal heelout lhe"),
    "heel_inside": ("foot", (-0.045, 0.060, 0.035), SKIN, "heelmed sustali medheel mcal heelin st "
                    "mhe"),
    "toe": ("foot", (0.130, 0.0875, 0.050), BONE, "toe mt2 toemid sm fm2 toes mth2 smh dmt2 "
            "forefoot toe2 mtp2 dm2 met2 meta2 2meta 2mt"),
    "first_metatarsal": ("foot", (0.135, 0.050, 0.035), BONE, "mt1 fm fm1 1meta toemed mtp1 mth1 "
                         "dmt1 forefootin toein 1mt dm1 met1 meta1 1mtp foot1 mhfi fmh footin"),
    "fifth_metatarsal": ("foot", (0.100, 0.135, 0.030), BONE, "mt5 vm fm5 5meta toelat mtp5 mth5 "
                         "dmt5 forefootout toeout 5mt dm5 met5 meta5 5mtp smalltoe foot5 vmh "
                         "footout mtv met"),
    "fifth_base": ("foot", (0.035, 0.130, 0.030), SKIN, "vmb pmt5 p5mt midfootlat mid mt5b 5base "
                   "fmt"),
    "midfoot": ("foot", (0.070, 0.085, 0.085), SKIN, "midfootsup navicular nav tn instep cun mft "
                "midfoot dorsum fmb smb"),
    "toe_tip": ("foot", (0.205, 0.070, 0.030), SKIN, "toetip bigtoe hlx hallux hal toeend ttip dp1 "
                "ppd bt hux tip footindex"),
    # shoulder girdle
    "acromion": ("clavicle", (-0.005, 0.175, 1.475), BONE, "sho shoulder acr acro acromium "
                 "acromion shouldertop saj ac shld acj sae shou acrm ap shouldtop acromial "
                 "should"),
    "shoulder_back": ("clavicle", (-0.080, 0.150, 1.450), CLUSTER, "shoulderback shob bsho sbak "
                      "rearshoulder backsho"),
    "shoulder_front": ("clavicle", (0.050, 0.160, 1.440), CLUSTER, "shoulderfront fsho shof "
                       "frontsho asho"),
    "sternum_side": ("chest", (0.065, 0.035, 1.400), SKIN, "sternum clav sc clavicle scj"),
    "scapula": ("chest", (-0.130, 0.100, 1.390), CLUSTER, "bak bac back scap scapula sia ia "
                "scapinf offset scp ang scapularinferior"),
    "chest_side": ("chest", (0.10, 0.10, 1.33), CLUSTER, "chest breast rib nip thx"),
    # arm
    "upper_arm": ("upper_arm", (0.0, 0.230, 1.290), CLUSTER, "upa uparm uarm humerus arm bicep "
                  "biceps wand4 armwand uarmhigh armhigh upperarm deltoid delt armlat ua1 ua2 ua3 "
                  "upa1 upa2 upa3 armupper uar tricep triceps hum upb upc"),
    "elbow_lateral": ("upper_arm", (-0.005, 0.228, 1.155), BONE, "elb elbow elblat elbowlat lelbow "
                      "hle el elbl elbowout lel elblateral elbowlateral lelb elbo hel laelb raelb "
                      "latelbow oel elbowouter lhe1 elw lep1"),
    "elbow_medial": ("upper_arm", (-0.005, 0.146, 1.155), BONE, "elbm elbmed elbowmed melbow hme "
                     "em elbowin mel melb elbowmedial hem medelbow iel elbin elbowinner elbmedial"),
    "forearm": ("forearm", (0.0, 0.222, 1.030), CLUSTER, "frm farm forearm fra fore wand3 lowerarm "
                "fa1 fa2 fa3 frm1 frm2 frm3 ulnamid foa forearmwand frma"),
    "wrist_radius": ("forearm", (0.035, 0.184, 0.890), BONE, "wra rsp rs wristradius radius lwrist "
                     "wristlat wristlateral wristin radialwrist rad wrr rst iwr wrt wrthumb "
                     "wristthumb wrl wristrad radsty thumbwrist radstyl"),
    "wrist_ulna": ("forearm", (-0.035, 0.184, 0.890), BONE, "wrb uhe us usp wristulna ulna mwrist "
                   "wristmed wristmedial wristout ulnarwrist uln wru ust owr wrp wrpinky "
                   "wristpinky wristuln ulnsty wrm ulnstyl"),
    "wrist": ("forearm", (0.0, 0.205, 0.885), SKIN, "wri wrist wrs wr wristtop"),
    "hand": ("hand", (0.0, 0.212, 0.800), SKIN, "fin hand finger hnd hm3 mc3 hfin metacarpal3 fin3 "
             "knuckle mcp3 3mcp hee3 handtop"),
    "hand_radius": ("hand", (0.035, 0.198, 0.800), SKIN, "hm2 hm1 mc2 handin ihand indexhand mcp2 "
                    "hl2 fin1 fin2 2mcp idx mch2 thumbhand hanl index"),
    "hand_ulna": ("hand", (-0.035, 0.198, 0.805), SKIN, "hm5 hm4 mc5 handout ohand pinkyhand mcp5 "
                  "hl5 fin5 5mcp pnk mch5 hanr pinky"),
    "thumb": ("hand", (0.06, 0.180, 0.820), CLUSTER, "thm thmb thumb thmtip thb1 thu"),
    # head
    "head_front_side": ("head", (0.085, 0.070, 1.680), SKIN, "fhd hdf headfront fronthead fhead "
                        "frontalhead fheadside"),
    "head_back_side": ("head", (-0.085, 0.070, 1.680), SKIN, "bhd hdb headback backhead rearhead "
                       "bhead"),
    "head_side": ("head", (0.0, 0.080, 1.660), SKIN, "head headside ear hd tragion trag temple hds "
                  "sidehead sidh"),
    "eye": ("head", (0.095, 0.032, 1.640), SKIN, "eye orb"),
}  # fmt: skip
# Joint key points (OpenPose and its kin): the middle of the joint, not the skin beside it.
_KEYPOINTS: dict[str, tuple[str, tuple[float, float, float], float, str]] = {
    "hip_centre_k": ("pelvis", (0.0, 0.0875, 0.9275), BONE, "hip"),
    "knee_centre_k": ("thigh", (0.0, 0.0875, 0.4988), BONE, "knee"),
    "ankle_centre_k": ("shank", (0.0, 0.0875, 0.068), BONE, "ankle"),
    "shoulder_centre_k": ("clavicle", (-0.0035, 0.184, 1.434), BONE, "shoulder"),
    "elbow_centre_k": ("upper_arm", (-0.0035, 0.184, 1.151), BONE, "elbow"),
    "wrist_centre_k": ("forearm", (-0.0035, 0.184, 0.881), BONE, "wrist"),
    "ball_k": ("foot", (0.13, 0.0875, 0.03), BONE, "foot"),
}
_KEYPOINTS_MID: dict[str, tuple[str, tuple[float, float, float], float, str]] = {
    "midhip_k": ("pelvis", (0.0, 0.0, 0.9275), BONE, "hip chip pelvis root"),
    "neck_k": ("chest", (0.0, 0.0, 1.47), BONE, "neck thorax cshoulder midshoulder"),
}
# Further meanings of labels: (landmark, label). The table above holds the first.
_SECOND_MEANINGS = (
    ("heel", "hel"), ("heelside", "lhe"), ("ankle", "lm"), ("elblat", "le"), ("elbmed", "me"),
    ("toe", "tip"), ("kne", "lep1"), ("hand", "fin1"),
)  # fmt: skip
# Labels whose side stands inside the word.
_INFIX = {
    "waistlfront": "lasis", "waistrfront": "rasis", "waistlback": "lpsis", "waistrback": "rpsis",
    "backleft": "lscapula", "backright": "rscapula", "backl": "lscapula", "backr": "rscapula",
    "headl": "lheadside", "headr": "rheadside", "headleft": "lheadside", "headright": "rheadside",
    "waistl": "liliaccrest", "waistr": "riliaccrest", "chestl": "lchestside",
    "chestr": "rchestside", "chestleft": "lchestside", "chestright": "rchestside",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Landmark:
    """A place on the body: segment index, local position on the reference actor, spread (m)."""

    name: str
    segment: int
    local: Floats
    spread: float


def normal_label(label: str) -> str:
    """A label without subject prefix, case, separators and OpenCap's suffix."""
    bare = re.sub(r"[^a-z0-9]", "", label.rsplit(":", 1)[-1].lower())
    return bare.removesuffix("study")


def subjects(labels: Sequence[str]) -> tuple[str, ...]:
    """Whose marker each label is: what stands before a colon, "" where nothing does.

    A beginning before an underscore, blank or hyphen counts too ("Bob_LASI", "A_LASI",
    "Skeleton 001_LASI"), if enough labels carry it and become known by taking it off, but not
    with it.
    """
    found = [label.rpartition(":")[0] for label in labels]
    if any(found):
        return tuple(found)
    table = _tables(keypoints=False)
    counts = Counter(start for label in labels for start in _beginnings(label))
    names = [""] * len(labels)
    for name in sorted((n for n, c in counts.items() if c >= _SUBJECT), key=len):
        own = [i for i, label in enumerate(labels) if name in _beginnings(label)]
        gained = sum(normal_label(labels[i][len(name) :]) in table for i in own)
        known = sum(normal_label(labels[i][len(names[i]) :]) in table for i in own)
        if gained >= _SUBJECT and known <= 0.2 * gained:
            names = [name if i in own else other for i, other in enumerate(names)]
    return tuple(names)


def _beginnings(label: str) -> list[str]:
    """What a label begins with, up to each of its separators."""
    return [label[: match.start()] for match in re.finditer(r"(?<=[^_ -])[_ -]+(?=[^_ -])", label)]


def _ending(labels: Sequence[str]) -> str:
    """What nearly all labels end with after a separator ("_pos", " 1"), if it hides their names."""
    ends = Counter(m[0] for label in labels if (m := re.search(r"[_ .-]+[^_ .-]+$", label)))
    if not ends:
        return ""
    end, count = ends.most_common(1)[0]
    own = [label for label in labels if label.endswith(end)]
    table = _tables(keypoints=False) | _tables(keypoints=True)
    known = sum(normal_label(label) in table for label in own)
    gained = sum(normal_label(label.removesuffix(end)) in table for label in own)
    hides = gained >= _SUBJECT and known <= 0.4 * gained
    return end if count >= 0.8 * len(labels) and hides else ""


def recognise(labels: Sequence[str]) -> tuple[Landmark | None, ...]:
    """The landmark of each label, None where it is not known; see :func:`meanings`."""
    return tuple(marks[0] if marks else None for marks in meanings(labels))


def meanings(labels: Sequence[str]) -> tuple[tuple[Landmark, ...], ...]:
    """The landmarks that each label may stand for, the likeliest first, () where it is not known.

    "HEL" is the heel in one laboratory and the lateral epicondyle of the humerus in another: the
    names alone cannot tell, positions can.
    """
    owners = subjects(labels)
    bare = [label.removeprefix(owner) for label, owner in zip(labels, owners, strict=True)]
    end = _ending(bare)
    normal = [normal_label(label.removesuffix(end)) for label in bare]
    centres = _joint_centre_landmarks([label.removesuffix(end) for label in bare], normal)
    if centres is not None:
        return tuple((mark,) if mark else () for mark in centres)
    keypoints = _are_keypoints(normal)
    augmented = [label.lower().endswith("study") for label in labels]
    if any(augmented):  # video key points beside augmented markers add nothing but noise
        keypoints = False
        normal = [n if a else "" for n, a in zip(normal, augmented, strict=True)]
    table = _tables(keypoints)
    return tuple(table.get(name, ()) for name in normal)


def known_landmarks() -> dict[str, str]:
    """Every landmark of skin markers by its name, with a label that means it.

    Returns:
        Landmark → label.
    """
    found: dict[str, str] = {}
    for label, marks in _tables(keypoints=False).items():
        found.setdefault(marks[0].name, label)
    return found


def exchanged(landmarks: Sequence[Landmark | None]) -> tuple[Landmark | None, ...]:
    """The same landmarks with left and right exchanged."""
    names = {
        mark.name: mark
        for keypoints in (True, False)
        for marks in _tables(keypoints).values()
        for mark in marks
    }
    other = {"left": "right", "right": "left"}
    turned = []
    for mark in landmarks:
        side, _, rest = mark.name.partition(" ") if mark else ("", "", "")
        turned.append(names[f"{other[side]} {rest}"] if side in other else mark)
    return tuple(turned)


_PELVIC = re.compile(r"(asis?|psis?|ias|(?<!h)ips|sacr|sacrum|vsacral|waist\w*|[fb]wt)[lr]?$")


def _are_keypoints(normal: Sequence[str]) -> bool:
    """Whether labels (normal) are joints as video sees them: hips, but no bone of the pelvis."""
    if {"rhip", "lhip", "rknee", "rbigtoe", "rankle"} <= set(normal):
        return True
    joints = [{f"{side}{joint}" for joint in ("hip", "knee", "ankle")} for side in _SIDE_PREFIX]
    paired = all(a <= set(normal) or b <= set(normal) for a, b in (joints[:2], joints[2:]))
    return paired and not any(_PELVIC.search(label) for label in normal)


# Where the joints of a skeleton are worn (see names.py), by the names of landmarks above.
_JOINT_CENTRES = {
    "thigh": "hip_centre_k", "shank": "knee_centre_k", "foot": "ankle_centre_k", "toe": "ball_k",
    "upper_arm": "shoulder_centre_k", "forearm": "elbow_centre_k", "hand": "wrist_centre_k",
    "finger": "hand",
}  # fmt: skip
_LEGS = {f"{side}_{part}" for side in ("left", "right") for part in ("thigh", "shank", "foot")}


def _joint_centre_landmarks(
    labels: Sequence[str], normal: Sequence[str]
) -> tuple[Landmark | None, ...] | None:
    """Landmarks of labels that name a skeleton's joints, None if these are skin markers.

    Both legs must be complete, and nothing may sit on the bones of the pelvis. Names of joints as
    video systems have them are left to the key points, which know eyes and ears besides.
    """
    if _are_keypoints(normal) or any(_PELVIC.search(label) for label in normal):
        return None
    roles = recognise_centres(labels)
    if not roles.keys() >= _LEGS | {"hips"}:
        return None
    named = {mark.name: mark for marks in _tables(keypoints=True).values() for mark in marks}
    found: list[Landmark | None] = [None] * len(labels)
    for role, index in roles.items():
        side, _, part = role.partition("_")
        if part in _JOINT_CENTRES:
            found[index] = named[f"{side} {_JOINT_CENTRES[part]}"]
    found[roles["hips"]] = named["midhip_k"]
    if "neck" in roles:
        found[roles["neck"]] = named["neck_k"]
    if "head" in roles:
        found[roles["head"]] = replace(named["nose"], name="head", local=np.zeros(3), spread=SKIN)
    return tuple(found)


_SIDE_PREFIX = ("l", "left", "r", "right")


@lru_cache(maxsize=2)
def _tables(keypoints: bool) -> dict[str, tuple[Landmark, ...]]:
    centres = _joint_centres()
    table: dict[str, tuple[Landmark, ...]] = {}

    def enter(keys: Sequence[str], name: str, segment: str, place: Floats, spread: float) -> None:
        index = SEGMENT[segment]
        landmark = Landmark(name, index, place - centres[index], spread)
        for key in keys:
            table.setdefault(key, (landmark,))

    def enter_sided(name: str, entry: tuple[str, tuple[float, float, float], float, str]) -> None:
        segment, place, spread, text = entry
        for side, letter, sign in (("left", "l", 1.0), ("right", "r", -1.0)):
            aliases = [name.replace("_", ""), *text.split()]
            keys = [f"{letter}{a}" for a in aliases] + [f"{side}{a}" for a in aliases]
            own = segment if segment in SEGMENT else f"{side}_{segment}"
            where = np.array(place) * [1.0, sign, 1.0]
            enter(keys, f"{side} {name}", own, where, spread)

    middle = {**(_KEYPOINTS_MID if keypoints else {}), **_MID}
    for name, (segment, place, spread, text) in middle.items():
        enter(text.split(), name, segment, np.array(place), spread)
    if keypoints:
        for name, entry in _KEYPOINTS.items():
            enter_sided(name, entry)
    for name, entry in _SIDED.items():
        enter_sided(name, entry)
    for key, meaning in _INFIX.items():
        table.setdefault(key, table[meaning])
    for name, key in _SECOND_MEANINGS:
        for side, letter in (("left", "l"), ("right", "r")):
            other = table[f"{letter}{name}"]
            for word in (f"{letter}{key}", f"{side}{key}"):
                table[word] = (*table[word], *other)
    # Names with the side at the end ("ASIS_L", "Knee_Left") come last: weakest claim.
    for name, (_, _, _, text) in _SIDED.items():
        for alias in [name.replace("_", ""), *text.split()]:
            for side, letter in (("left", "l"), ("right", "r")):
                if len(alias) > 2:
                    table.setdefault(f"{alias}{letter}", table[f"{letter}{alias}"])
                table.setdefault(f"{alias}{side}", table[f"{side}{alias}"])
    return table


def _joint_centres() -> Floats:
    """World joint centres (18, 3) of the reference actor in the zero pose."""
    shape = ActorShape.reference()
    centres = shape.offset.copy()
    for segment, parent in enumerate(PARENTS):
        if parent >= 0:
            centres[segment] += centres[parent]
    return centres


def up_axis(labels: Sequence[str], position: Floats, stated: str | None = None) -> str | None:
    """The axis along which head and shoulders are above the feet; None if that is unclear.

    Poses decide, so that a header that lies does no harm; clips on all fours or lying down stay
    undecided, and so does a handstand: an axis points down only where the hands, too, are on the
    feet's side of the head.

    Args:
        labels: Marker names.
        position: (T, M, 3) in the file's axes and unit.
        stated: What the file says or what its format is used to; a body that lies on that floor
            is not taken for one that stands on another.

    Returns:
        "x", "y" or "z", with "-" before it where the axis points down.
    """
    some, way = _feet_to_head(labels, position)
    if not len(way):
        return None
    length = np.linalg.norm(way, axis=1)
    seen = upright_axis(way / length[:, None])
    if seen is None:
        down = upright_axis(-way / length[:, None])
        return f"-{down}" if down and _hands_below_head(labels, some, f"-{down}") else None
    if stated is None or seen == stated:
        return seen
    return None if lies_down(some, stated, seen, float(np.median(length))) else seen


def upside_down(labels: Sequence[str], position: Floats, axis: str) -> bool:
    """Whether the feet are above the head along an axis, "x" or "-x", in most frames."""
    _, way = _feet_to_head(labels, position)
    if not len(way):
        return False
    along = way[:, "xyz".index(axis[-1])] / np.linalg.norm(way, axis=1)
    return float(np.mean(along)) * (-1 if axis[0] == "-" else 1) < -0.6


def _hands_below_head(labels: Sequence[str], some: Floats, axis: str) -> bool:
    """Whether hands, or forearms, hang below the head along ``axis`` in most frames."""
    marks = recognise(labels)
    sign = -1.0 if axis[0] == "-" else 1.0
    height = sign * some[..., "xyz".index(axis[-1])]

    def on(*parts: str) -> Floats:
        chosen = [i for i, m in enumerate(marks) if m and SEGMENTS[m.segment].endswith(parts)]
        known = np.isfinite(height[:, chosen])
        total = np.where(known, height[:, chosen], 0.0).sum(axis=1)
        mean: Floats = total / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
        return mean

    gap = on("head", "chest", "clavicle") - on("hand", "forearm")
    return bool(np.isfinite(gap).any() and np.nanmean(gap > 0) > 0.6)


def _feet_to_head(labels: Sequence[str], position: Floats) -> tuple[Floats, Floats]:
    """A sample of frames (S, M, 3), and the way from feet to head in those that show both."""
    high, low = [], []
    marks = recognise(labels)
    for i, landmark in enumerate(marks):
        if landmark is None:
            continue
        if SEGMENTS[landmark.segment] in ("head", "chest"):
            high.append(i)
        elif SEGMENTS[landmark.segment].endswith(("_foot", "_shank")):
            low.append(i)
    if not high:  # legs alone
        high = [i for i, mark in enumerate(marks) if mark and SEGMENTS[mark.segment] == "pelvis"]
    some = position[:: max(1, len(position) // 300)]
    if not high or not low:
        return some, np.empty((0, 3))
    way = _mean_known(some[:, high]) - _mean_known(some[:, low])
    return some, way[np.nan_to_num(np.linalg.norm(way, axis=1)) > 0]


def _mean_known(position: Floats) -> Floats:
    """Mean over markers (T, 3) of those that are visible; NaN where none is."""
    known = np.asarray(np.isfinite(position).all(axis=-1))
    count = known.sum(axis=1)[:, None]
    total = np.where(known[..., None], position, 0.0).sum(axis=1)
    mean: Floats = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return mean
