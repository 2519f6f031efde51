"""A scene as one MuJoCo model, for the two screens that MuJoCo draws: video and window.

Every body of every figure becomes a mocap body that is put where the track says; nothing is
simulated. So both screens draw exactly what the browser draws, whatever models the figures had.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.replay.scene import Array, Figure, Scene, Shape

_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}
NEUTRAL = (0.78, 0.80, 0.84)
FORCE_RGBA = np.array([0.07, 0.71, 0.65, 1.0], dtype=np.float32)
CONTACT_RGBA = np.array([0.09, 0.78, 0.52, 1.0], dtype=np.float32)
# One body weight is drawn as long as 0.45 of the figure's height, as in the browser.
FORCE_SCALE = 0.45
# Geom groups 1 to 5 tell the figures of a split scene apart; group 0 is the floor.
MAX_VIEWS = 5
_TOO_SMALL_FOR_A_MESH = 4


class Stage:
    """The compiled model of a scene and the means to pose it at a time.

    ``size`` m is the height of its tallest shown figure, for cameras.
    """

    def __init__(self, scene: Scene, *, width: int = 1280, height: int = 720) -> None:
        self.scene = scene
        self.figures = tuple(f for f in scene.figures if not f.hidden) or scene.figures[:1]
        self.size = max(f.height for f in self.figures)
        self.model = _model(self.figures, self.size, width, height)
        self.data = mujoco.MjData(self.model)
        self._mocap = [_mocap_ids(self.model, k, f) for k, f in enumerate(self.figures)]

    def pose(self, seconds: float) -> int:
        """Put everything where it is at a time; returns the frame on the clock."""
        frame, part = self.scene.clock.between(seconds)
        after = min(frame + 1, self.scene.clock.frames - 1)
        for figure, (bodies, ids) in zip(self.figures, self._mocap, strict=True):
            position = _blend(figure.position[:, bodies], frame, after, part)
            self.data.mocap_pos[ids] = position + self.offset(figure)
            rotation = _blend(figure.rotation[:, bodies], frame, after, part)
            self.data.mocap_quat[ids] = rotation / np.linalg.norm(rotation, axis=1, keepdims=True)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        return frame

    def put(self, index: int, figure: Figure, frame: int) -> None:
        """Put the shapes of a figure where a track of another one of the same shapes is."""
        bodies, ids = self._mocap[index]
        self.data.mocap_pos[ids] = figure.position[frame, bodies]
        rotation = figure.rotation[frame, bodies]
        self.data.mocap_quat[ids] = rotation / np.linalg.norm(rotation, axis=1, keepdims=True)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def light(self, middle: Array) -> None:
        """Let the key light go with who is seen: its shadows are sharp near its middle alone."""
        self.data.light_xpos[0] = self.model.light_pos[0] + [middle[0], middle[1], 0.0]

    def offset(self, figure: Figure) -> Array:
        """Where a figure stands: at its own place on one stage, else at its real one."""
        if self.scene.layout != "stage" or len(self.figures) == 1:
            return np.zeros(3)
        return np.array(figure.offset)

    def views(self) -> tuple[tuple[int, ...], ...]:
        """The figures of each view: one view for each when the scene is split, else one for all."""
        everyone = tuple(range(len(self.figures)))
        if self.scene.layout == "split" and 1 < len(everyone) <= MAX_VIEWS:
            return tuple((k,) for k in everyone)
        return (everyone,)

    def options(self, view: tuple[int, ...]) -> mujoco.MjvOption:
        """What MuJoCo must show for a view: floor and the view's figures, by geom group."""
        options = mujoco.MjvOption()
        mujoco.mjv_defaultOption(options)
        options.geomgroup[:] = 0
        options.geomgroup[[0, *(_group(k) for k in view)]] = 1
        return options

    def middle(self, seconds: float, view: tuple[int, ...]) -> Array:
        """Mean centre of mass (3,) of a view's figures, for cameras that follow."""
        frame, part = self.scene.clock.between(seconds)
        after = min(frame + 1, self.scene.clock.frames - 1)
        shown = [self.figures[k] for k in view]
        centres = [_blend(f.com, frame, after, part) + self.offset(f) for f in shown]
        return np.asarray(np.mean(centres, axis=0), dtype=np.float64)

    def extent(self, view: tuple[int, ...]) -> tuple[float, float]:
        """Height and width (m) that a view's camera must see: figures and their places."""
        shown = [self.figures[k] for k in view]
        tall = max(f.height for f in shown)
        places = np.array([self.offset(f)[:2] for f in shown])
        return tall, 0.8 * tall + float(np.max(np.ptp(places, axis=0)))

    def draw_over(self, scene: mujoco.MjvScene, frame: int, view: tuple[int, ...]) -> None:
        """Add force arrows and standing contact points of a frame to a view's picture."""
        for k in view:
            figure, (bodies, ids) = self.figures[k], self._mocap[k]
            self._arrows(scene, figure, frame)
            self._contacts(scene, figure, frame, dict(zip(bodies, ids, strict=True)))

    def _arrows(self, scene: mujoco.MjvScene, figure: Figure, frame: int) -> None:
        if figure.forces is None:
            return
        offset = self.offset(figure)
        for origin, vector in zip(
            figure.forces.origin[frame], figure.forces.vector[frame], strict=True
        ):
            length = float(np.linalg.norm(vector))
            if not np.isfinite(origin).all() or not 0.01 < length < np.inf:
                continue
            start = origin + offset
            geom = _extra(scene, mujoco.mjtGeom.mjGEOM_ARROW, FORCE_RGBA)
            if geom is not None:
                drawn = FORCE_SCALE * figure.height * drawn_weights(length)
                end = start + drawn * vector / length
                width = 0.014 * figure.height
                mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, width, start, end)

    def _contacts(
        self, scene: mujoco.MjvScene, figure: Figure, frame: int, ids: dict[int, int]
    ) -> None:
        contacts = figure.contacts
        if contacts is None or contacts.active is None:
            return
        for k in np.flatnonzero(contacts.active[frame]):
            at = ids.get(int(contacts.body[k]))
            geom = _extra(scene, mujoco.mjtGeom.mjGEOM_SPHERE, CONTACT_RGBA)
            if at is None or geom is None:
                continue
            place = np.empty(3)
            mujoco.mju_rotVecQuat(place, contacts.local[k], self.data.mocap_quat[at])
            geom.pos[:] = place + self.data.mocap_pos[at]
            geom.size[:] = 0.016 * figure.height


def drawn_weights(bw: float) -> float:
    """Length of an arrow in drawn body weights: beyond two it grows with the logarithm.

    Landings reach ten body weights and more; an arrow as long would leave every picture.
    """
    return bw if bw <= 2.0 else 2.0 + float(np.log(bw / 2.0))


def _extra(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, rgba: NDArray[np.float32]
) -> mujoco.MjvGeom | None:
    """One more decorative geom in a picture, None when it is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
    geom.emission = 0.4
    scene.ngeom += 1
    return geom


def _blend(track: Array, frame: int, after: int, part: float) -> Array:
    return np.asarray((1 - part) * track[frame] + part * track[after], dtype=np.float64)


def _group(figure: int) -> int:
    return 1 + figure % MAX_VIEWS


def _body_name(figure: int, body: int) -> str:
    return f"f{figure}b{body}"


def _mocap_ids(model: mujoco.MjModel, index: int, figure: Figure) -> tuple[list[int], list[int]]:
    bodies = sorted({shape.body for shape in figure.shapes})
    ids = [int(model.body_mocapid[model.body(_body_name(index, body)).id]) for body in bodies]
    return bodies, ids


def _model(figures: tuple[Figure, ...], size: float, width: int, height: int) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.modelname = "stage"
    quality = spec.visual
    quality.global_.offwidth, quality.global_.offheight = width, height
    quality.global_.fovy = 30.0
    quality.quality.shadowsize = 2048
    quality.headlight.ambient[:] = 0.46
    quality.headlight.diffuse[:] = 0.28
    quality.headlight.specular[:] = 0.05
    quality.map.znear, quality.map.zfar, quality.map.shadowclip = 0.01, 60.0, 1.6
    quality.rgba.haze[:] = (0.90, 0.92, 0.95, 1.0)
    spec.stat.extent, spec.stat.center[:] = 2.0 * size, (0.0, 0.0, 0.5 * size)
    _surroundings(spec, size)
    for k, figure in enumerate(figures):
        _add_figure(spec, k, figure)
    return spec.compile()


def _surroundings(spec: mujoco.MjSpec, size: float) -> None:
    """A pale studio: gradient sky, metre tiles, one key light with shadows."""
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.96, 0.97, 0.99],
        rgb2=[0.90, 0.92, 0.95],
        width=256,
        height=1536,
    )
    spec.add_texture(
        name="tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.93, 0.945, 0.97],
        rgb2=[0.93, 0.945, 0.97],
        markrgb=[0.66, 0.71, 0.79],
        width=512,
        height=512,
    )
    floor = spec.add_material(name="floor", texrepeat=[2, 2], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[40, 40, 0.1],
        material="floor",
        contype=0,
        conaffinity=0,
    )
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        # It shines at half the height of who stands at the origin.
        pos=[1.71 * size, 1.22 * size, 4 * size],
        dir=[-0.42, -0.3, -0.86],
        diffuse=[0.55, 0.53, 0.50],
        specular=[0.3, 0.3, 0.3],
        castshadow=True,
    )


def _add_figure(spec: mujoco.MjSpec, index: int, figure: Figure) -> None:
    bodies = {
        body: spec.worldbody.add_body(name=_body_name(index, body), mocap=True)
        for body in sorted({shape.body for shape in figure.shapes})
    }
    for number, shape in enumerate(figure.shapes):
        name = f"f{index}s{number}"
        _add_shape(spec, bodies[shape.body], figure, shape, name, _group(index))


def _add_shape(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    figure: Figure,
    shape: Shape,
    name: str,
    group: int,
) -> None:
    painted = figure.repaint or not shape.declared
    color = figure.tint if painted and figure.tint else shape.rgba[:3]
    if not shape.declared and figure.tint is None:
        color = NEUTRAL
    spec.add_material(
        name=name,
        rgba=[*color, shape.rgba[3] * figure.opacity],
        emission=shape.emission,
        shininess=shape.gloss,
        specular=0.5 * shape.gloss,
    )
    common = {
        "pos": shape.position,
        "quat": shape.rotation,
        "material": name,
        "group": group,
        "contype": 0,
        "conaffinity": 0,
    }
    if shape.vertices is None or shape.faces is None:
        body.add_geom(type=_TYPES[shape.kind], size=shape.size, **common)
        return
    if len(shape.vertices) < _TOO_SMALL_FOR_A_MESH:
        return
    mesh = spec.add_mesh(name=name, uservert=shape.vertices.ravel(), userface=shape.faces.ravel())
    # Lengths, not volumes, matter here; open shells such as a lampshade have no volume.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    body.add_geom(type=_TYPES["mesh"], meshname=name, **common)
