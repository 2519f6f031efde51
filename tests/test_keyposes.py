from __future__ import annotations

import contextlib
import hashlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from physretarget import keyposes
from physretarget.capture.actor import NQ, SEGMENT, ActorShape
from physretarget.errors import InputError
from physretarget.features import features
from physretarget.gl import NoRenderingError
from physretarget.keyposes import (
    KeyPose,
    KeyPoseSet,
    actor_character_of_reference,
    check,
    gaze_of_actor,
    load_keyposes,
    merged,
    propose,
    sheet,
    training_pairs,
    without_heading,
)
from physretarget.keyposes.face import face_of
from physretarget.keyposes.propose import planted_points
from physretarget.kinematics import forward, points, rotvec_to_quat
from physretarget.mjcf import Character

Array = NDArray[np.float64]
MODELS = Path(__file__).parents[1] / "models"
FREE = ("lamp.keyposes.toml",)
BANDAI = ("lamp.bandai-nc.keyposes.toml",)
FEET = ("left_heel", "left_toe", "right_heel", "right_toe")


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(MODELS / "lamp.xml")


@pytest.fixture(scope="module")
def penguin() -> Character:
    return Character.load(MODELS / "penguin.xml")


def standing() -> Array:
    qpos = np.zeros(NQ)
    qpos[:3] = ActorShape.reference().offset[0]
    qpos[3::4] = 1.0
    return qpos


def turned(segment: str, degrees: tuple[float, float, float], qpos: Array | None = None) -> Array:
    result = standing() if qpos is None else qpos.copy()
    at = 3 + 4 * SEGMENT[segment]
    result[at : at + 4] = rotvec_to_quat(np.radians(degrees))
    return result


def some(character: Character, count: int = 2) -> KeyPoseSet:
    poses = tuple(
        KeyPose(
            name=f"pose {i}",
            source="take.bvh",
            sha256="ab",
            time=0.5 * i,
            actor_qpos=turned("chest", (0.0, 30.0 * i, 0.0)),
            qpos=character.reference_qpos,
            planted=FEET,
            note='with "quotes" and a [bracket',
        )
        for i in range(count)
    )
    return KeyPoseSet(
        character_name=character.name,
        character_sha256=character.sha256,
        license="zlib",
        poses=poses,
    )


# ------------------------------------------------------------------------------------- the files


def test_round_trip(lamp: Character, tmp_path: Path) -> None:
    first = some(lamp)
    path = tmp_path / "some.toml"
    keyposes.save(first, path, lamp)
    again = keyposes.load(path, lamp)
    assert again.license == "zlib"
    assert again.remarks == ()
    for a, b in zip(first.poses, again.poses, strict=True):
        assert (a.name, a.source, a.time, a.planted, a.note) == (
            b.name, b.source, b.time, b.planted, b.note,
        )  # fmt: skip
        np.testing.assert_allclose(b.qpos, a.qpos, atol=1e-5)
        np.testing.assert_allclose(b.actor_qpos, a.actor_qpos, atol=2e-5)
    before = path.read_bytes()
    keyposes.save(again, path, lamp)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@settings(max_examples=40, deadline=None)
@given(
    roll=st.floats(-80, 80),
    pitch=st.floats(-80, 80),
    height=st.floats(-0.2, 1.0),
    angles=st.lists(st.floats(-0.5, 0.5), min_size=7, max_size=7),
)
def test_any_pose_survives_the_table(
    roll: float, pitch: float, height: float, angles: list[float]
) -> None:
    from physretarget.keyposes.layout import layout_of

    character = Character.load(MODELS / "lamp.xml") if not _CACHE else _CACHE[0]
    _CACHE[:] = [character]
    qpos = character.reference_qpos.copy()
    qpos[2], qpos[7:] = height, angles
    qpos[3:7] = rotvec_to_quat(np.radians([roll, pitch, 0.0]))
    layout = layout_of(character)
    np.testing.assert_allclose(layout.qpos(layout.table(qpos)), qpos, atol=2e-5)


_CACHE: list[Character] = []


def test_a_heading_cannot_be_saved(lamp: Character, tmp_path: Path) -> None:
    poses = some(lamp)
    turn = poses.poses[0].qpos.copy()
    turn[3:7] = rotvec_to_quat(np.array([0.0, 0.0, 0.5]))
    wrong = replace(poses, poses=(replace(poses.poses[0], qpos=turn),))
    with pytest.raises(InputError, match="no heading"):
        keyposes.save(wrong, tmp_path / "x.toml", lamp)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "message", "at"),
    [
        ("elbow_pitch = ", "elbow = ", "unknown joint 'elbow'; the joints are root", "elbow ="),
        ("elbow_pitch = ", "#elbow_pitch = ", "no value for elbow_pitch", "[pose.character]"),
        ("head_roll = 0.0", "head_roll = nan", "'head_roll' needs a finite number", "head_roll"),
        ("head = [0.0, 0.0, 0.0]", "head = [0.0, 0.0]", "rotation vector of 3", "head = "),
        ("height = ", "hight = ", "needs height", "pelvis"),
        ("name = \"lamp\"", "name = \"penguin\"", "key poses of 'penguin'", "name = "),
        ("reference_actor = \"1\"", "reference_actor = \"0\"", "reference actor '0'", "reference"),
        ("format = \"physretarget", "format = \"else", "is no key pose file", "format"),
        ("time = 0.5", "time = -1", "number of seconds", "time = -1"),
        ("\"left_heel\", ", "\"left_ear\", ", "'left_ear' is no contact point", "planted"),
        ("name = \"pose 1\"", "name = \"pose 0\"", "two key poses are named", "name = \"pose 0\""),
        ("note = ", "mood = ", "unknown key 'mood'", "mood"),
        ("license = ", "license = = ", "no valid TOML", "license"),
    ],
)  # fmt: skip
def test_errors_name_the_line(
    lamp: Character, tmp_path: Path, old: str, new: str, message: str, at: str
) -> None:
    path = tmp_path / "bad.toml"
    keyposes.save(some(lamp), path, lamp)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=r"\A[^\n]*\Z") as caught:
        keyposes.load(path, lamp)
    assert message in str(caught.value)
    assert caught.value.line is not None
    assert at in path.read_text().splitlines()[caught.value.line - 1]


def test_key_poses_of_another_character_are_refused(
    lamp: Character, penguin: Character, tmp_path: Path
) -> None:
    path = tmp_path / "lamp.toml"
    keyposes.save(some(lamp), path, lamp)
    with pytest.raises(InputError, match="key poses of 'lamp', but the character is 'penguin'"):
        keyposes.load(path, penguin)


def test_another_version_of_the_model_is_remarked(lamp: Character, tmp_path: Path) -> None:
    path = tmp_path / "lamp.toml"
    keyposes.save(some(lamp), path, lamp)
    path.write_text(path.read_text().replace(lamp.sha256, "0" * 64))
    loaded = keyposes.load(path, lamp)
    assert "another version" in loaded.remarks[0]
    assert any("another version" in remark.message for remark in check(loaded, lamp))


HOSTILE = [
    b"x = " + b"[" * 8000,  # nested until the stack ends
    b"[" + b"a." * 100_000 + b"a]",  # takes a minute to read
    b"x = " + b"9" * 8000,  # a number of too many digits
    b"#\n" * (5 * 2**20),
]


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[[pose]]", b"pose = 3", *HOSTILE])
def test_garbage_is_refused(lamp: Character, tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(InputError):
        keyposes.load(path, lamp)
    with pytest.raises(InputError, match="cannot be read"):
        keyposes.load(tmp_path / "none.toml", lamp)


@settings(max_examples=60, deadline=None)
@given(at=st.integers(0, 4000), what=st.text(max_size=4))
def test_a_damaged_file_gives_poses_or_an_input_error(at: int, what: str) -> None:
    from physretarget.keyposes.file import _Reader

    character = Character.load(MODELS / "lamp.xml") if not _CACHE else _CACHE[0]
    _CACHE[:] = [character]
    text = (MODELS / FREE[0]).read_text()[:4000]
    damaged = text[:at] + what + text[at + 2 :]
    import tomllib

    try:
        content = tomllib.loads(damaged)
    except tomllib.TOMLDecodeError:
        return
    with contextlib.suppress(InputError):
        _Reader(Path("x"), damaged, character).read(content)


def test_merging(lamp: Character, penguin: Character) -> None:
    first = some(lamp)
    renamed = replace(
        first,
        license="CC0",
        poses=tuple(replace(pose, name=pose.name + "b") for pose in first.poses),
    )
    both = merged([first, renamed])
    assert len(both) == 4
    assert both.license == "zlib; CC0"
    with pytest.raises(InputError, match="two key poses are named 'pose 0'"):
        merged([first, first])
    with pytest.raises(InputError, match="cannot join"):
        merged([first, some(penguin)])


# ---------------------------------------------------------------------------------------- checks


def _spoilt(poses: KeyPoseSet, **changes: object) -> KeyPoseSet:
    return replace(poses, poses=(replace(poses.poses[0], **changes),))  # type: ignore[arg-type]


def test_check_passes_what_is_sound(lamp: Character) -> None:
    remarks = check(some(lamp), lamp)
    assert [r for r in remarks if r.severity == "error"] == []


def test_check_finds_limits_floor_heading_and_feet(lamp: Character) -> None:
    base = some(lamp, 1)
    qpos = base.poses[0].qpos

    bent = qpos.copy()
    bent[10] = 3.5
    assert "elbow_pitch is 200.5 degrees" in check(_spoilt(base, qpos=bent), lamp)[0].message

    sunk = qpos.copy()
    sunk[2] = -0.02
    messages = [remark.message for remark in check(_spoilt(base, qpos=sunk), lamp)]
    assert any("20.0 mm into the floor" in text for text in messages)
    assert sum("off the floor" in text for text in messages) == 4

    yawed = qpos.copy()
    yawed[3:7] = rotvec_to_quat(np.array([0.0, 0.0, 0.2]))
    assert "heading of 11.46 degrees" in check(_spoilt(base, qpos=yawed), lamp)[0].message

    away = qpos.copy()
    away[0] = 0.1
    assert "not at zero" in check(_spoilt(base, qpos=away), lamp)[0].message


def test_check_finds_contradictions(lamp: Character) -> None:
    first = some(lamp, 1).poses[0]
    other = first.qpos.copy()
    other[10] += 0.5
    twins = replace(some(lamp), poses=(first, replace(first, name="twin", qpos=other)))
    (remark,) = check(twins, lamp)
    assert remark.severity == "error"
    assert "'pose 0'" in remark.message
    same = replace(twins, poses=(first, replace(first, name="twin")))
    (remark,) = check(same, lamp)
    assert remark.severity == "warning"


def test_check_finds_neighbours_that_ask_for_far_apart_poses(lamp: Character) -> None:
    """A wrist bent a little on the actor, the lamp bent over: named, with both distances."""
    first = some(lamp, 1).poses[0]
    leap, actor = first.qpos.copy(), first.actor_qpos.copy()
    bent = leap[8:11] + np.array([1.2, -1.2, 1.2])
    leap[8:11] = np.clip(bent, lamp.lower[8:11], lamp.upper[8:11])
    actor[7:] = first.actor_qpos[7:] + 0.02
    near = replace(first, name="near", actor_qpos=actor)
    set_of = replace(some(lamp), poses=(first, near))
    assert not any("the map leaps" in remark.message for remark in check(set_of, lamp))
    set_of = replace(set_of, poses=(first, replace(near, qpos=leap)))
    (told,) = [r for r in check(set_of, lamp) if "the map leaps" in r.message]
    assert told.severity == "warning"
    assert "'pose 0'" in told.message
    assert "% of its height" in told.message


# --------------------------------------------------------------------------------- first operations


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
@pytest.mark.parametrize("look", [(0.0, 0.0, 0.0), (0.0, 25.0, 0.0), (0.0, -15.0, 30.0)])
def test_proposed_face_follows_the_gaze_and_feet_stand(
    name: str, look: tuple[float, float, float]
) -> None:
    character = Character.load(MODELS / f"{name}.xml")
    actor = turned("head", look)
    qpos = propose(character, actor)
    pose = forward(character.tree, qpos[None])
    found = face_of(character)
    assert found is not None
    body, _, direction = found
    assert pose.rotation[0, body] @ direction @ gaze_of_actor(actor) > np.cos(np.radians(6))
    place = points(pose, character.contacts.body, character.contacts.local)[0]
    feet = [i for i, tie in enumerate(character.tied) if tie in FEET]
    np.testing.assert_allclose(place[feet, 2], 0.0, atol=2e-3)
    assert (qpos >= character.lower - 1e-9).all()
    assert (qpos <= character.upper + 1e-9).all()


def test_proposed_root_follows_the_pelvis_in_the_air(penguin: Character) -> None:
    actor = standing()
    actor[2] += 0.2
    actor[3:7] = rotvec_to_quat(np.radians([10.0, 20.0, 0.0]))
    assert planted_points(actor) == ()
    qpos = propose(penguin, actor)
    np.testing.assert_allclose(np.abs(qpos[3:7] @ actor[3:7]), 1.0, atol=1e-9)
    pose = forward(penguin.tree, qpos[None])
    low = points(pose, penguin.contacts.body, penguin.contacts.local)[0, :, 2].min()
    model = actor_character_of_reference()
    at = forward(model.tree, actor[None])
    lowest = points(at, model.contacts.body, model.contacts.local)[0, :, 2].min()
    assert low == pytest.approx(lowest, abs=1e-6)


def test_proposals_do_not_depend_on_the_actors_heading_or_place(lamp: Character) -> None:
    actor = turned("chest", (5.0, 20.0, 10.0))
    moved = actor.copy()
    moved[:2] = 3.0, -2.0
    spin = rotvec_to_quat(np.array([0.0, 0.0, 2.0]))
    from physretarget.kinematics import quat_multiply

    moved[3:7] = quat_multiply(spin, actor[3:7])
    np.testing.assert_allclose(propose(lamp, moved), propose(lamp, actor), atol=1e-6)


def test_without_heading_keeps_features(lamp: Character) -> None:
    qpos = lamp.reference_qpos.copy()
    qpos[:3] = 1.0, 2.0, 0.3
    qpos[3:7] = rotvec_to_quat(np.array([0.2, -0.3, 1.0]))
    np.testing.assert_allclose(
        features(lamp, without_heading(qpos)[None]), features(lamp, qpos[None]), atol=1e-12
    )


# -------------------------------------------------------------------------------- the shipped poses


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
@pytest.mark.parametrize("kinds", [("",), (".bandai-nc",), ("", ".bandai-nc", ".cmu")])
def test_shipped_poses_are_sound(name: str, kinds: tuple[str, ...]) -> None:
    character = Character.load(MODELS / f"{name}.xml")
    poses = load_keyposes([MODELS / f"{name}{kind}.keyposes.toml" for kind in kinds], character)
    assert poses.remarks == ()  # posed on this very model
    remarks = check(poses, character)
    # Hand-made poses contradict each other here and there, which their author should know.
    assert [r for r in remarks if "leaps" not in r.message and "more pairs" not in r.message] == []
    assert len(poses) >= 36
    assert len({pose.source for pose in poses.poses}) >= 4


def test_all_styles_are_posed() -> None:
    for name in ("lamp", "penguin", "squirrel"):
        text = (MODELS / f"{name}.bandai-nc.keyposes.toml").read_text()
        for style in ("angry", "happy", "sad", "tired", "not-confident", "normal"):
            assert text.count(f'name = "{style}-') >= 5, (name, style)


@pytest.mark.parametrize(("name", "least"), [("lamp", 3), ("penguin", 3), ("squirrel", 4)])
def test_some_poses_are_upside_down(name: str, least: int) -> None:
    character = Character.load(MODELS / f"{name}.xml")
    poses = load_keyposes(sorted(MODELS.glob(f"{name}*.keyposes.toml")), character).poses
    actor = actor_character_of_reference()
    found = 0
    for pose in poses:
        both = ((actor, pose.actor_qpos), (character, pose.qpos))
        tilt = [(forward(c.tree, q[None]).rotation[0, c.root_body] @ c.up)[2] for c, q in both]
        found += max(tilt) < 0.0
        # The root is tilted as the actor's, where nothing holds it to the floor.
        assert max(tilt) > 0.0 or abs(tilt[0] - tilt[1]) < 0.35, pose.name
    assert found >= least


def test_files_state_their_licences() -> None:
    for path in sorted(MODELS.glob("*.keyposes.toml")):
        text = path.read_text()
        if ".bandai-nc." in path.name:
            assert "CC BY-NC 4.0" in text.splitlines()[1]
        elif ".cmu." in path.name:
            assert "CMU Graphics Lab" in text.splitlines()[1]
            assert text.count(".c3d") == text.count("[[pose]]")
        else:
            assert "zlib" in text.splitlines()[1]
            assert "dataset-1" not in text  # nothing from the non-commercial captures


def test_the_jump_squashes_stretches_and_flies(lamp: Character) -> None:
    poses = {pose.name: pose for pose in load_keyposes(MODELS / FREE[0], lamp).poses}
    head = lamp.model.body("shade").id

    def head_height(name: str) -> float:
        at = forward(lamp.tree, poses[name].qpos[None])
        return float(at.position[0, head, 2] - poses[name].qpos[2])

    assert head_height("jump-squash") < 0.6 * head_height("jump-attentive")
    assert head_height("jump-rise") > 1.1 * head_height("jump-attentive")
    # time is not scaled, so a hop must be as high as the actor's jump, in metres
    assert 0.15 < poses["jump-apex"].qpos[2] < 0.3


def test_lamp_stands_over_its_feet_where_both_sides_are_planted(lamp: Character) -> None:
    data = mujoco.MjData(lamp.model)
    for pose in load_keyposes([MODELS / n for n in FREE + BANDAI], lamp).poses:
        if len(pose.planted) < 4:
            continue
        data.qpos[:] = pose.qpos
        mujoco.mj_kinematics(lamp.model, data)
        mujoco.mj_comPos(lamp.model, data)
        assert np.abs(data.subtree_com[lamp.root_body, :2]).max() < 0.084, pose.name


def test_pairs_have_a_row_per_pose(lamp: Character) -> None:
    poses = load_keyposes(MODELS / FREE[0], lamp)
    y, z = training_pairs(poses, lamp)
    assert y.shape[0] == z.shape[0] == len(poses)
    assert z.shape[1] == 3 * len(lamp.markers)
    # each on its own: no pose depends on its neighbours
    alone, _ = training_pairs(replace(poses, poses=poses.poses[5:6]), lamp)
    np.testing.assert_array_equal(alone[0], y[5])
    with pytest.raises(InputError, match="no key poses"):
        training_pairs(replace(poses, poses=()), lamp)


def test_poses_are_those_of_their_captures(data: Path, lamp: Character) -> None:
    """The actor's side really is the named frame of the named file."""
    from physretarget.capture import load

    for pose in load_keyposes(MODELS / BANDAI[0], lamp).poses[::11]:
        path = data / "bvh" / "bandai" / pose.source
        assert hashlib.sha256(path.read_bytes()).hexdigest() == pose.sha256
        motion = load(path).on(ActorShape.reference())
        frame = int(np.abs(motion.time - pose.time).argmin())
        actor = actor_character_of_reference()
        now = features(actor, without_heading(motion.qpos[frame])[None])
        then = features(actor, pose.actor_qpos[None])
        # Fits may improve; a pose that is 3 cm off no longer belongs to this frame.
        assert np.sqrt(np.mean((now - then) ** 2)) < 0.03


def test_sheet_is_a_picture_of_all_pairs(lamp: Character, tmp_path: Path) -> None:
    try:
        sheet(some(lamp, 3), lamp, tmp_path / "sheet.png")
    except NoRenderingError as error:
        pytest.skip(str(error))
    picture = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert picture.shape[0] > 250
    assert picture.shape[1] > 1400
    assert picture.std() > 20
