"""The file is the truth: saved with every change, taken back, never written over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from physretarget.errors import InputError, PhysretargetError, UsageError
from physretarget.keyposes import actor_character_of_reference, check, load, propose
from physretarget.keyposes.limbs import limb_names, limbs_of
from physretarget.kinematics import forward, points
from physretarget.mjcf import Character
from physretarget.studio import Conflict, Session, Take


def test_a_pose_begins_sound_and_is_in_the_file(session: Session) -> None:
    name = session.add(0, 0.4, session.revision)
    stored = load(session.path, session.character)
    assert [pose.name for pose in stored.poses] == [name]
    assert not [r for r in check(stored, session.character) if r.severity == "error"]
    assert stored.poses[0].source == "humanoid3d_walk.txt"


def test_what_stands_stands_where_its_pose_says(session: Session) -> None:
    session.add(0, 0.4, session.revision)
    (pose,) = session.keyposes.poses
    character = session.character
    at = forward(character.tree, pose.qpos[None])
    height = points(at, character.contacts.body, character.contacts.local)[0, :, 2]
    down = [tie in pose.planted for tie in character.tied]
    assert any(down)
    np.testing.assert_allclose(height[down], character.floor_height, atol=1e-3)


def test_undo_and_redo_go_all_the_way(session: Session) -> None:
    states = [b""]
    for step in range(4):
        session.add(0, 0.1 + 0.2 * step, session.revision)
        states.append(session.path.read_bytes())
    for back in reversed(range(1, 4)):
        session.undo(session.revision)
        assert session.path.read_bytes() == states[back]
    session.undo(session.revision)
    assert len(session.keyposes) == 0
    with pytest.raises(UsageError, match="nothing to undo"):
        session.undo(session.revision)
    for forth in range(1, 5):
        session.redo(session.revision)
        assert session.path.read_bytes() == states[forth]
    with pytest.raises(UsageError, match="nothing to do again"):
        session.redo(session.revision)


def test_a_new_change_forgets_what_was_taken_back(session: Session) -> None:
    session.add(0, 0.1, session.revision)
    session.undo(session.revision)
    session.add(0, 0.5, session.revision)
    assert session.redoable is None


def test_an_old_revision_changes_nothing(session: Session) -> None:
    before = session.revision
    session.add(0, 0.1, before)
    kept = session.path.read_bytes()
    with pytest.raises(Conflict):
        session.add(0, 0.5, before)
    assert session.path.read_bytes() == kept


def test_hand_edits_are_picked_up_and_can_be_undone(session: Session) -> None:
    name = session.add(0, 0.1, session.revision)
    before = session.path.read_bytes()
    revision = session.revision
    session.path.write_text(session.path.read_text().replace(name, "edited by hand"))
    assert [pose.name for pose in session.keyposes.poses] == ["edited by hand"]
    assert session.revision > revision
    with pytest.raises(Conflict):
        session.delete("edited by hand", revision)
    session.undo(session.revision)
    assert session.path.read_bytes() == before


def test_a_file_that_cannot_be_read_is_never_written_over(session: Session) -> None:
    session.add(0, 0.1, session.revision)
    broken = session.path.read_text() + "\n[[pose]\n"
    session.path.write_text(broken)
    for change in (
        lambda: session.add(0, 0.5, session.revision),
        lambda: session.undo(session.revision),
        lambda: session.delete("x", session.revision),
    ):
        with pytest.raises(InputError, match="TOML"):
            change()
    assert session.path.read_text() == broken


def test_an_emptied_file_opens_again(session: Session) -> None:
    name = session.add(0, 0.1, session.revision)
    session.delete(name, session.revision)
    assert len(Session(session.character, session.path).keyposes) == 0


def test_a_mirrored_pair_mirrored_is_the_pair(session: Session) -> None:
    name = session.add(0, 0.25, session.revision)
    twin = session.mirror(name, session.revision)
    back = session.mirror(twin, session.revision)
    first, other, third = (session.find(each) for each in (name, twin, back))
    np.testing.assert_allclose(third.actor_qpos, first.actor_qpos, atol=1e-9)
    np.testing.assert_allclose(third.qpos, first.qpos, atol=5e-3)
    assert np.abs(other.qpos - first.qpos).max() > 0.02, "a step is not its own mirror image"
    assert not [r for r in check(session.keyposes, session.character) if r.severity == "error"]


def test_a_mirror_image_has_the_points_of_the_other_side(session: Session) -> None:
    """The twin: points of contact, reflected, of the original pose."""
    name = session.add(0, 0.25, session.revision)
    twin = session.find(session.mirror(name, session.revision))
    character, contacts = session.character, session.character.contacts
    at = [
        points(forward(character.tree, qpos[None]), contacts.body, contacts.local)[0]
        for qpos in (session.find(name).qpos, twin.qpos)
    ]
    names = list(contacts.names)
    swap = {"left": "right", "right": "left"}
    source = [names.index(next(n.replace(s, swap[s]) for s in swap if s in n)) for n in names]
    np.testing.assert_allclose(at[1], at[0][source] * [1, -1, 1], atol=3e-3)


def test_a_whole_blend_is_the_other_pose(session: Session) -> None:
    first = session.add(0, 0.1, session.revision)
    other = session.add(0, 0.5, session.revision)
    goal = session.find(other).qpos
    session.blend(first, other, 0.0, session.revision)
    unmoved = session.find(first).qpos
    session.blend(first, other, 1.0, session.revision)
    moved = session.find(first).qpos
    assert np.abs(moved - goal).max() < 0.2 * np.abs(unmoved - goal).max()


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_is_between_none_and_all(session: Session, share: float) -> None:
    first = session.add(0, 0.1, session.revision)
    other = session.add(0, 0.5, session.revision)
    with pytest.raises(UsageError, match="between 0 and 1"):
        session.blend(first, other, share, session.revision)


def test_what_makes_no_sense_changes_nothing(session: Session) -> None:
    name = session.add(0, 0.1, session.revision)
    kept = session.path.read_bytes()
    nq = session.character.tree.nq
    for change in (
        lambda: session.put(name, np.full(nq, np.nan), session.revision),
        lambda: session.put(name, np.zeros(3), session.revision),
        lambda: session.put(name, np.zeros(nq), session.revision, planted=["tail"]),
        lambda: session.rename(name, "  ", session.revision),
        lambda: session.rename("no such", "x", session.revision),
        lambda: session.add(7, 0.1, session.revision),
        lambda: session.delete("no such", session.revision),
    ):
        with pytest.raises(PhysretargetError):
            change()
    assert session.path.read_bytes() == kept


def test_joints_stay_within_their_limits(session: Session) -> None:
    name = session.add(0, 0.1, session.revision)
    character = session.character
    wild = session.find(name).qpos + 0.0
    wild[7:] = 3.0
    session.put(name, wild, session.revision)
    qpos = session.find(name).qpos
    assert (qpos <= character.upper + 1e-9).all()
    assert (qpos >= character.lower - 1e-9).all()


def test_a_killed_studio_is_at_most_one_gesture_behind(
    session: Session, penguin: Character, takes: tuple[Take, ...]
) -> None:
    """Killed again and again while it writes without a pause: the file is whole every time."""
    script = (
        "import sys\nfrom pathlib import Path\nfrom physretarget.mjcf import Character\n"
        "from physretarget.studio import Session\n"
        "s = Session(Character.load(sys.argv[1]), Path(sys.argv[2]))\n"
        "name = s.keyposes.poses[0].name\nprint('ready', flush=True)\n"
        "for k in range(100000):\n"
        "    new = f'pose {k}'\n    s.rename(name, new, s.revision)\n    name = new\n"
        "    print(k, flush=True)\n"
    )
    session.add(0, 0.1, session.revision)
    assert penguin.path is not None
    for wait in (0.01, 0.05, 0.11):
        child = subprocess.Popen(
            [sys.executable, "-c", script, str(penguin.path), str(session.path)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(wait)
        os.kill(child.pid, signal.SIGKILL)
        told = child.stdout.read().split()
        child.wait()
        (pose,) = Session(penguin, session.path, takes).keyposes.poses
        done = int(told[-1]) if told else -1
        known = int(pose.name.split()[1]) if pose.name.startswith("pose ") else -1
        assert known in (done, done + 1) or done == -1
    assert not [
        p for p in session.path.parent.iterdir() if p.suffix == ".toml" and p != session.path
    ]


def test_a_file_of_another_character_is_refused(session: Session, tmp_path: Path) -> None:
    from physretarget.demo import models_folder

    lamp = Character.load(models_folder() / "lamp.xml")
    session.add(0, 0.1, session.revision)
    with pytest.raises(InputError, match="penguin"):
        Session(lamp, session.path)


def test_a_limb_is_chosen_kept_and_taken_back(session: Session) -> None:
    """The left flipper, told to do what the right arm does, rises with it."""
    names = limb_names(session.character)
    left = next(n for n in names if "left" in n and "flipper" in n)
    raised = actor_character_of_reference().reference_qpos.copy()
    raised[0:7] = [0, 0, 0.95, 1, 0, 0, 0]
    joints = actor_character_of_reference().tree.joints
    body = {actor_character_of_reference().model.body(j.body).name: j for j in joints}
    arm = body["right_upper_arm"]
    raised[arm.qpos : arm.qpos + 4] = [np.cos(0.7), -np.sin(0.7), 0, 0]  # out to the right
    session.choose_limb("right_arm", left, session.revision)
    assert dict(load(session.path, session.character).limbs) == {"right_arm": left}
    acts = {limb.name: limb.first for limb in limbs_of(session.character, session.keyposes.limbs)}
    assert session.character.model.body(acts["right_arm"]).name == left
    assert "left_arm" not in acts, "a limb acts for one of the actor's only"
    poses = [
        propose(session.character, raised, limbs=limbs) for limbs in ((), session.keyposes.limbs)
    ]
    first = next(i for i in range(session.character.model.nbody)
                 if session.character.model.body(i).name == left)  # fmt: skip
    tips = [forward(session.character.tree, p[None]).rotation[0, first] for p in poses]
    turn = np.arccos(np.clip((np.trace(tips[0].T @ tips[1]) - 1) / 2, -1, 1))
    assert turn > np.radians(20)
    session.undo(session.revision)
    assert session.keyposes.limbs == ()


def test_a_limb_that_is_none_is_refused(session: Session) -> None:
    with pytest.raises(InputError, match="no limb of the actor"):
        session.choose_limb("tail", "", session.revision)
    with pytest.raises(InputError, match="where no limb of 'penguin' begins: they begin at"):
        session.choose_limb("left_arm", "trunk", session.revision)
    session.add(0, 0.1, session.revision)
    text = session.path.read_text().replace("[[pose]]", '[limbs]\nleft_arm = "nose"\n\n[[pose]]', 1)
    session.path.write_text(text)
    with pytest.raises(InputError, match="left_arm is 'nose'") as told:
        load(session.path, session.character)
    assert told.value.line == text[: text.index('left_arm = "nose"')].count("\n") + 1
