from __future__ import annotations

import io
import json
import socket
import threading
import time as clock
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget import capture, ik, kinematics
from physretarget.capture.actor import CONTACT_POINTS, ActorMotion, ActorShape
from physretarget.cli import stream as command
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.features import features
from physretarget.keyposes import load_keyposes
from physretarget.mapping.track import track
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.stream import Posed, Streamer
from physretarget.stream.body import Body, Solver
from physretarget.stream.place import Heading
from physretarget.stream.touch import Toucher
from physretarget.trained import TrainedMapper, learn

Array = NDArray[np.float64]
MODELS = models_folder()


@pytest.fixture(scope="module", params=["lamp", "squirrel"])
def mapper(request: pytest.FixtureRequest) -> TrainedMapper:
    character = Character.load(MODELS / f"{request.param}.xml")
    return learn(character, load_keyposes(MODELS / f"{request.param}.keyposes.toml", character))


@pytest.fixture(scope="module")
def jump(motions: Path) -> ActorMotion:
    return capture.load(motions / "humanoid3d_jump.txt").on(ActorShape.reference())


@pytest.fixture(scope="module")
def both(mapper: TrainedMapper, jump: ActorMotion) -> tuple[Retargeted, list[Posed]]:
    """The batch path up to contact, and the stream over the very same frames."""
    batch = retarget(jump, mapper, settings=RetargetSettings(until="contacted"))
    return batch, streamed(mapper, batch)


def streamed(mapper: TrainedMapper, batch: Retargeted, *, delay: float = 0.0) -> list[Posed]:
    frames = zip(batch.motion.time.tolist(), batch.motion.qpos, strict=True)
    return list(Streamer(mapper, delay=delay).play(frames))


def marker_rms(character: Character, a: Array, b: Array) -> Array:
    at = [
        kinematics.points(
            kinematics.forward(character.tree, q), character.markers.body, character.markers.local
        )
        for q in (a, b)
    ]
    rms: Array = np.sqrt(np.mean(np.sum((at[0] - at[1]) ** 2, axis=2), axis=1))
    return rms


def test_poses_and_places_are_those_of_the_batch_path(
    both: tuple[Retargeted, list[Posed]],
) -> None:
    batch, stream = both
    assert batch.placed is not None
    mapped = marker_rms(batch.character, np.array([p.mapped for p in stream]), batch.pose.qpos)
    placed = marker_rms(batch.character, np.array([p.placed for p in stream]), batch.placed.qpos)
    height = batch.character.height
    assert np.median(mapped) < 0.005 * height
    assert np.quantile(mapped, 0.99) < 0.02 * height
    assert np.median(placed) < 0.005 * height
    assert np.quantile(placed, 0.99) < 0.02 * height


def test_held_points_hold_still_on_the_floor(both: tuple[Retargeted, list[Posed]]) -> None:
    batch, stream = both
    character = batch.character
    pose = kinematics.forward(character.tree, np.array([p.qpos for p in stream]))
    points = kinematics.points(pose, character.contacts.body, character.contacts.local)
    held = np.array([p.active for p in stream])
    assert held.mean() > 0.3
    assert np.abs(points[..., 2][held]).max() < 0.003
    still = held[1:] & held[:-1]
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=2) * 60.0
    assert np.median(speed[still]) < 0.005
    assert np.quantile(speed[still], 0.95) < 0.05


def test_contacts_are_found_as_by_the_batch_path(both: tuple[Retargeted, list[Posed]]) -> None:
    batch, stream = both
    assert batch.phases is not None
    assert batch.phases.names == CONTACT_POINTS
    found = np.array([p.touch.active for p in stream])
    assert np.mean(found == batch.phases.active) > 0.97


def test_a_landing_is_foreseen(both: tuple[Retargeted, list[Posed]]) -> None:
    _, stream = both
    left = CONTACT_POINTS.index("left_toe")
    on = np.array([p.touch.active[left] for p in stream])
    ahead = np.array([p.touch.landing[left] for p in stream])
    down = int(np.flatnonzero(on[1:] & ~on[:-1])[-1]) + 1
    assert np.isfinite(ahead[down - 1])
    assert 0.0 < ahead[down - 1] < 0.15
    assert ahead[down] == 0.0


def test_nothing_jumps(both: tuple[Retargeted, list[Posed]]) -> None:
    batch, stream = both
    assert batch.contacted is not None
    qpos = np.array([p.qpos for p in stream])
    step = marker_rms(batch.character, qpos[1:], qpos[:-1])
    usual = marker_rms(batch.character, batch.contacted.qpos[1:], batch.contacted.qpos[:-1])
    assert step.max() < 2.5 * usual.max()


def test_the_fast_search_finds_what_the_batch_search_finds(
    mapper: TrainedMapper, jump: ActorMotion
) -> None:
    y = features(mapper.actor, jump.qpos)
    tracker = track(mapper.mapper)
    mean = np.array([tracker.next(frame).mean[0] for frame in y])
    miss = (mean - mapper.mapper.predict(y).mean).reshape(len(y), -1, 3)
    rms = np.sqrt(np.mean(np.sum(miss**2, axis=2), axis=1))
    assert np.median(rms) < 0.005 * mapper.character.height


@pytest.mark.parametrize("name", ["gp", "pca", "nn3"])
def test_other_mappers_are_just_asked(name: str) -> None:
    character = Character.load(MODELS / "lamp.xml")
    keyposes = load_keyposes(MODELS / "lamp.keyposes.toml", character)
    mapper = learn(character, keyposes, mapper=name)
    streamer = Streamer(mapper)
    posed = streamer.next(0.0, keyposes.poses[3].actor_qpos)
    assert posed is not None
    wanted = ik.solve(
        character,
        mapper.mapper.predict(features(mapper.actor, keyposes.poses[3].actor_qpos[None])).mean,
        start=keyposes.poses[3].qpos[None],
    )
    assert marker_rms(character, posed.mapped[None], wanted.qpos)[0] < 0.01


def test_mass_matrix_trick_equals_least_squares(mapper: TrainedMapper) -> None:
    character = mapper.character
    rng = np.random.default_rng(0)
    solver = Solver(character, character.markers, steps=60)
    solver.lock(np.arange(character.root_dof, character.root_dof + 2))
    for qpos in mapper.qpos[:8]:
        noisy = features(character, qpos[None]) + 0.003 * rng.normal(size=(1, mapper.z.shape[1]))
        wanted = ik.solve(character, noisy, start=qpos[None])
        target = noisy.reshape(-1, 3)
        solver.body.pose(solver.solve(qpos, target, tolerance=1e-8))
        miss = solver.body.points(character.markers) - target
        assert np.sqrt(np.mean(np.sum(miss**2, axis=1))) < wanted.residual_rms[0] + 3e-4


def test_bare_body_is_where_the_character_is(mapper: TrainedMapper) -> None:
    character = mapper.character
    body = Body(character)
    qpos = mapper.qpos[5]
    body.pose(qpos)
    pose = kinematics.forward(character.tree, qpos[None])
    wanted = kinematics.points(pose, character.markers.body, character.markers.local)[0]
    assert body.points(character.markers) == pytest.approx(wanted, abs=1e-12)


def test_heading_follows_a_turn_and_survives_a_somersault() -> None:
    def about(axis: int, angle: float) -> Array:
        turn = np.zeros(3)
        turn[axis] = angle
        quat = kinematics.rotvec_to_quat(turn)
        return kinematics.quat_to_matrix(quat)

    heading = Heading(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    turned = [heading.next(about(2, a)) for a in np.linspace(0, 7, 100)]
    assert turned[-1] == pytest.approx(7.0)
    heading = Heading(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    over = [heading.next(about(1, a)) for a in np.linspace(0, 2 * np.pi, 200)]
    assert np.abs(over).max() < 1e-9


def test_touch_knows_neither_frame_rate_nor_floor_height() -> None:
    for fps, floor in ((30.0, 0.0), (120.0, 0.3)):
        toucher = Toucher(0.9)
        time = np.arange(0, 3, 1 / fps)
        lift = 0.3 * np.maximum(np.sin(2 * np.pi * time), 0.0)
        place = np.zeros((len(time), len(CONTACT_POINTS), 3))
        place[..., 2] = floor + lift[:, None]
        found = np.array([toucher.next(p, 1 / fps).active[0] for p in place])
        late = time > 1.0
        assert np.mean(found[late & (lift == 0)]) > 0.9
        assert not found[late & (lift > 0.08)].any()


def test_the_first_pose_is_sought_to_its_end(mapper: TrainedMapper, jump: ActorMotion) -> None:
    streamer = Streamer(mapper)
    posed = [streamer.next(k / 60.0, jump.qpos[0]) for k in range(4)]
    mapped = np.array([p.mapped for p in posed if p is not None])
    step = marker_rms(mapper.character, mapped[1:], mapped[:-1])
    assert step.max() < 2e-3 * mapper.character.height


def test_refusals(mapper: TrainedMapper, jump: ActorMotion) -> None:
    streamer = Streamer(mapper)
    streamer.next(0.0, jump.qpos[0])
    with pytest.raises(InputError, match="frame 1: time"):
        streamer.next(0.0, jump.qpos[1])
    with pytest.raises(InputError, match="75 finite numbers"):
        streamer.next(1.0, jump.qpos[1] * np.nan)
    with pytest.raises(InputError, match="75 finite numbers"):
        streamer.next(1.0, jump.qpos[1][:-1])


def test_lines_in_lines_out(mapper: TrainedMapper, jump: ActorMotion) -> None:
    qpos = jump.qpos[0]
    joints = {"abdomen": qpos[7:11].tolist(), "pelvis": qpos[3:7].tolist()}
    lines = [
        json.dumps({"time": 0.0, "qpos": qpos.tolist()}),
        "",
        json.dumps({"time": 0.02, "position": qpos[:3].tolist(), "joints": joints}),
    ]
    out = io.StringIO()
    assert len(command._run(mapper, lines, out)) == 2
    first, second = (json.loads(line) for line in out.getvalue().splitlines())
    assert len(first["qpos"]) == mapper.character.model.nq
    assert first["latency_ms"] > 0
    assert second["time"] == 0.02


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "[]",
        '{"time": 0}',
        '{"time": 0, "qpos": ["x"]}',
        '{"time": 0, "position": [0, 0, 1], "joints": {"tail": [1, 0, 0, 0]}}',
    ],
)
def test_broken_lines_are_named(line: str) -> None:
    with pytest.raises(InputError, match="frame 7: a frame is"):
        command.parse(line, 7)


def test_a_socket_serves_one_stream_after_the_other(jump: ActorMotion, tmp_path: Path) -> None:
    character = Character.load(MODELS / "lamp.xml")
    mapper = learn(character, load_keyposes(MODELS / "lamp.keyposes.toml", character), mapper="gp")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    thread = threading.Thread(
        target=command._serve, args=(mapper, f"127.0.0.1:{port}"), daemon=True
    )
    thread.start()
    for _ in range(2):
        for _attempt in range(50):
            try:
                peer = socket.create_connection(("127.0.0.1", port), timeout=5)
                break
            except ConnectionRefusedError:
                clock.sleep(0.05)
        with peer, peer.makefile("rw") as file:
            for time, qpos in zip(jump.time[:3], jump.qpos, strict=False):
                file.write(json.dumps({"time": float(time), "qpos": qpos.tolist()}) + "\n")
                file.flush()
                assert len(json.loads(file.readline())["qpos"]) == character.model.nq
    with pytest.raises(UsageError, match="HOST:PORT"):
        command._serve(mapper, "nowhere")
