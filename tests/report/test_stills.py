"""Pictures of a film strip that are there before the browser has drawn any."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from physretarget import gl
from physretarget.mjcf import Character
from physretarget.replay.figures import figure
from physretarget.report import stills as module
from physretarget.report.stills import HEIGHT, WIDTH, Row, stills

BALL = """<mujoco model="ball"><worldbody><geom type="plane" size="0 0 1" rgba="1 0 0 1"/>
  <body name="ball" pos="0 0 0.1"><freejoint/>
  <geom type="sphere" size="0.1" mass="1" rgba="0 0 1 1"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def ball() -> Character:
    return Character.from_xml(BALL, name="ball")


def _hop() -> np.ndarray:
    """qpos (9, 7) of a ball that travels ten metres and hops by its own height on the way."""
    qpos = np.tile([0.0, 0, 0.1, 1, 0, 0, 0], (9, 1))
    qpos[:, 0] = np.linspace(0, 10, 9)
    qpos[4, 2] += 0.2
    return qpos


@pytest.fixture
def row(ball: Character) -> Row:
    return Row(
        look="ball",
        figure=figure(ball, _hop(), name="ball"),
        frames=np.array([0, 4, 8]),
    )


@pytest.fixture
def renders() -> None:
    try:
        gl.choose_backend()
    except gl.NoRenderingError as error:
        pytest.skip(str(error))


def _pictures(uri: str) -> np.ndarray:
    """(K, HEIGHT, WIDTH, 3)"""
    kind, content = uri.split(",")
    assert kind == "data:image/jpeg;base64"
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(content))), dtype=float)
    return picture.reshape(HEIGHT, -1, WIDTH, 3).swapaxes(0, 1)


def _blue(picture: np.ndarray) -> tuple[float, float]:
    """Where the ball is: column and row of its middle, pixels."""
    rows, columns = np.nonzero(picture[..., 2] > picture[..., 0] + 60)
    return float(columns.mean()), float(rows.mean())


@pytest.mark.usefixtures("renders")
def test_the_camera_goes_with_the_figure_and_shows_a_hop(row: Row) -> None:
    first, hop, last = _pictures(stills([row])[0])
    assert _blue(first)[0] == pytest.approx(WIDTH / 2, abs=2)
    np.testing.assert_allclose(_blue(last), _blue(first), atol=1)
    assert _blue(hop)[1] < _blue(first)[1] - 10


@pytest.mark.usefixtures("renders")
def test_rows_of_several_models_keep_their_order(row: Row) -> None:
    red = Character.from_xml(BALL.replace("0 0 1 1", "1 0 0 1"), name="red")
    qpos = np.tile([0.0, 0, 0.1, 1, 0, 0, 0], (9, 1))
    other = Row(look="red", figure=figure(red, qpos, name="red"), frames=row.frames[:1])
    blue, painted, again = stills([row, other, row])
    assert blue == again
    assert len(_pictures(painted)) == 1
    assert not (_pictures(painted)[..., 2] > _pictures(painted)[..., 0] + 60).any()


@pytest.mark.usefixtures("renders")
def test_the_shadow_and_the_light_go_with_the_figure(row: Row) -> None:
    """Ten metres on it looks as where it began, its shadow on the floor included."""
    first, _, last = _pictures(stills([row])[0])
    floor = first[-40:].mean(axis=2)  # below the ball
    assert floor.min() < 0.85 * np.median(floor)
    change = np.abs(first - last).mean(axis=2)  # some pixels of edges
    assert np.quantile(change, 0.95) < 12
    assert change.mean() < 4


@pytest.mark.usefixtures("renders")
def test_a_model_without_light_and_floor_is_seen_in_the_same_studio(row: Row) -> None:
    bare = BALL.replace('<geom type="plane" size="0 0 1" rgba="1 0 0 1"/>', "")
    character = Character.from_xml(bare, name="bare")
    dark = Row(look="bare", figure=figure(character, _hop(), name="bare"), frames=row.frames)
    assert stills([dark]) == stills([row])


def test_without_opengl_there_are_none(row: Row, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise gl.NoRenderingError("no")

    monkeypatch.setattr(module, "choose_backend", none)
    assert stills([row, row]) == ("", "")
