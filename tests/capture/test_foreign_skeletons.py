"""Quirks of other people's skeleton files, each of which once was refused or misread."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import PARENTS, SEGMENT, SEGMENTS, ActorShape
from physretarget.capture.bvh import read_bvh
from physretarget.capture.names import recognise
from physretarget.capture.skeleton import Raw, finish, to_world
from physretarget.errors import InputError
from physretarget.kinematics import forward

HIERARCHY = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  End Site
  {
    OFFSET 0 5 0
  }
}
MOTION
"""
HEAD = "Frames: 2\nFrame Time: 0.0333333\n"
ROWS = "1 2 3 0 0 0\n4 5 6 0 0 90\n"


@pytest.mark.parametrize(
    "text",
    [
        HIERARCHY + HEAD + "1 2 3\n0 0 0\n4 5 6\n0 0 90\n",
        HIERARCHY + HEAD + "1 2 3 0 0\n0 4 5\n6 0 0\n90\n",
        HIERARCHY.replace("End Site", "EndSite") + HEAD + ROWS,
        HIERARCHY + HEAD.replace("2\n", "2.0\n", 1) + ROWS,
        HIERARCHY + HEAD + ROWS + "\x1a",
        HIERARCHY + HEAD + ROWS + "\x00\x00",
        HIERARCHY.replace("0 5 0\n", "0 5 0\n    CHANNELS 0\n") + HEAD + ROWS,
        HIERARCHY.replace("0 5 0", "0 5,0 0") + HEAD.replace(".", ",") + ROWS.replace("3", "3,0"),
        HIERARCHY + HEAD + ROWS.replace(" ", ";"),
        HIERARCHY + HEAD + ROWS.replace(" ", ", "),
        HIERARCHY + HEAD + ROWS.replace("90", "9.0e+01"),
    ],
    ids=[
        "wrapped",
        "wrapped raggedly",
        "EndSite",
        "float count",
        "DOS end",
        "padding",
        "EndSite without channels",
        "decimal commas",
        "semicolons",
        "commas",
        "exponents",
    ],
)
def test_one_motion_in_many_spellings(tmp_path: Path, text: str) -> None:
    plain, odd = tmp_path / "plain.bvh", tmp_path / "odd.bvh"
    plain.write_text(HIERARCHY + HEAD + ROWS)
    odd.write_text(text)
    a, b = (read_bvh(path, unit="cm", up="y") for path in (plain, odd))
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.rotation, b.rotation)


def test_wide_characters_are_read(tmp_path: Path) -> None:
    path = tmp_path / "clip.bvh"
    path.write_bytes((HIERARCHY + HEAD + ROWS).encode("utf-16"))
    assert len(read_bvh(path).time) == 2


def test_wrapped_frames_that_are_cut_short_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.bvh"
    path.write_text(HIERARCHY + HEAD + "1 2 3\n0 0 0\n4 5 6\n0 0\n")
    with pytest.raises(InputError, match=r"clip\.bvh:14: A frame needs 6 values"):
        read_bvh(path)


def test_a_wrong_word_in_a_wrapped_frame_names_the_frame_s_line(tmp_path: Path) -> None:
    path = tmp_path / "clip.bvh"
    path.write_text(HIERARCHY + HEAD + "1 2 3\n0 0 0\n4 5 6\n0 0 x\n")
    with pytest.raises(InputError, match=r"clip\.bvh:16: .*not a number"):
        read_bvh(path)


def test_more_frames_than_declared_are_read_and_said(tmp_path: Path) -> None:
    path = tmp_path / "clip.bvh"
    path.write_text(HIERARCHY + HEAD + ROWS + "7 8 9 0 0 0\n")
    got = read_bvh(path)
    assert len(got.time) == 3
    assert any("2 frames are declared; all 3" in note for note in got.notes)


def chain(*names: str) -> tuple[list[str], list[int]]:
    """Names, and parents from leading dots: one more dot, one level deeper."""
    depth = [len(name) - len(name.lstrip(".")) for name in names]
    parents = [
        max((j for j in range(i) if depth[j] == depth[i] - 1), default=-1)
        for i in range(len(names))
    ]
    return [name.lstrip(".") for name in names], parents


def rig(hips: str, spine: str, head: list[str], limbs: dict[str, str]) -> list[str]:
    """A rig's names; ``limbs`` by side holds templates with @ for the joint."""
    tree = [hips, f".{spine}", *("." * (i + 2) + name for i, name in enumerate(head))]
    for shoulder, elbow, wrist, *_ in limbs.values():
        tree += [f"..{shoulder}", f"...{elbow}", f"....{wrist}"]
    for _, _, _, *leg in limbs.values():
        tree += ["." * (i + 1) + name for i, name in enumerate(leg)]
    return tree


@pytest.mark.parametrize(
    ("tree", "head", "elbow"),
    [
        (
            rig(
                "spine",
                "spine.003",
                ["spine.004", "spine.005", "spine.006"],
                {
                    s: [
                        f"upper_arm.{s}",
                        f"forearm.{s}",
                        f"hand.{s}",
                        f"thigh.{s}",
                        f"shin.{s}",
                        f"foot.{s}",
                    ]
                    for s in "LR"
                },
            ),
            "spine.006",
            "forearm.L",
        ),
        (
            rig(
                "Root_M",
                "Chest_M",
                ["Neck_M", "Head_M"],
                {
                    s: [
                        f"Shoulder_{s}",
                        f"Elbow_{s}",
                        f"Wrist_{s}",
                        f"Hip_{s}",
                        f"Knee_{s}",
                        f"Ankle_{s}",
                    ]
                    for s in "LR"
                },
            ),
            "Head_M",
            "Elbow_L",
        ),
        (
            rig(
                "Bob_Hip",
                "Bob_Chest",
                ["Bob_Neck", "Bob_Head"],
                {
                    s: [
                        f"Bob_{s}UArm",
                        f"Bob_{s}FArm",
                        f"Bob_{s}Hand",
                        f"Bob_{s}Thigh",
                        f"Bob_{s}Shin",
                        f"Bob_{s}Foot",
                    ]
                    for s in "LR"
                },
            ),
            "Bob_Head",
            "Bob_LFArm",
        ),
    ],
    ids=["Rigify", "Advanced Skeleton", "Motive"],
)
def test_heads_and_arms_of_more_rigs(tree: list[str], head: str, elbow: str) -> None:
    names, parents = chain(*tree)
    body = recognise(names, parents)
    assert names[body.roles["head"]] == head
    assert names[body.roles["left_forearm"]] == elbow
    assert not body.missing(f"{s}_{part}" for s in ("left", "right") for part in ("hand", "foot"))


def acrobat(up: str, tilt: np.ndarray, *, height: float = 0.0, along: bool = False) -> Raw:
    """A rigid human turned by ``tilt`` (T, rad) about the way it faces, feet at ``height``.

    ``along``: joint frames with x along the bones, so that the rest pose says nothing.
    """
    shape = ActorShape.reference()
    qpos = np.tile(shape.tree().neutral(), (len(tilt), 1))
    pose = forward(shape.tree(), qpos)
    turn = Rotation.from_rotvec(np.outer(tilt, [1.0, 0, 0])).as_matrix()
    position = np.einsum("tij,tkj->tki", turn, pose.position[:, 1:])
    position[..., 2] += height
    rotation = np.repeat(turn[:, None], len(SEGMENTS), axis=1)
    if along:
        axes = [Rotation.from_rotvec([0, np.pi / 2 * (1 if "s" in s else -1), 0]) for s in SEGMENTS]
        rotation = rotation @ np.stack([a.as_matrix() for a in axes])
    world = to_world(up)
    return Raw(
        path="made.bvh",
        sha256="0" * 64,
        format="bvh",
        fps=30.0,
        names=tuple({"pelvis": "hips", "head": "neck"}.get(name, name) for name in SEGMENTS),
        parents=PARENTS,
        position=position @ world * 100.0,
        rotation=np.einsum("ji,tkjl,lm->tkim", world, rotation, world),
    )


TURNING = np.concatenate([np.zeros(12), np.linspace(0, 2 * np.pi, 40), np.zeros(12)])


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("along", [False, True])
def test_acrobats_stand_before_and_after(up: str, along: bool) -> None:
    assert finish(acrobat(up, TURNING, along=along), unit=None, up=None).source.up == up


@pytest.mark.parametrize("up", ["y", "z"])
def test_who_lies_on_the_floor_is_not_taken_for_standing(up: str) -> None:
    lying = acrobat(up, np.full(10, np.pi / 2), height=0.1)
    world = to_world(up)
    lying.position[:] += np.array([0.0, 4.0, 0.0]) @ world * 100.0  # far from the origin
    assert finish(lying, unit=None, up=None).source.up == up


def test_a_handstand_is_no_file_upside_down() -> None:
    assert finish(acrobat("y", np.full(10, np.pi)), unit=None, up=None).source.up == "y"


@pytest.mark.parametrize("up", ["-x", "-y", "-z"])
def test_axes_that_point_down(up: str) -> None:
    raw = acrobat(up, np.zeros(10))
    got = finish(raw, unit=None, up=None)
    assert got.source.up == up
    foot, head = SEGMENT["left_foot"], SEGMENT["head"]
    assert (got.position[:, head, 2] > got.position[:, foot, 2] + 1.0).all()
    left, right = SEGMENT["left_thigh"], SEGMENT["right_thigh"]
    assert (got.position[:, left, 1] > got.position[:, right, 1]).all()
    np.testing.assert_allclose(np.linalg.det(got.rotation), 1.0)
