"""glTF 2.0 in one binary file: a node per body with its visible shapes, moved in the world.

Written with pygltflib, a thin mapping of the format's JSON (extra ``gltf``); shapes that are no
meshes are tessellated by trimesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.errors import MissingExtraError
from physretarget.mjcf import Character
from physretarget.replay.figures import figure
from physretarget.replay.scene import Shape

FLOAT, UINT, SCALAR, VEC3, VEC4 = 5126, 5125, "SCALAR", "VEC3", "VEC4"
# z up to y up: a quarter turn about x, xyzw.
UPRIGHT = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]


def glb_bytes(clip: Clip, character: Character) -> bytes:
    """The character's visible shapes and the clip as its only animation.

    Raises:
        MissingExtraError: pygltflib is not installed.
    """
    try:
        import pygltflib
    except ModuleNotFoundError as error:
        raise MissingExtraError("pygltflib", extra="gltf", purpose="Writing glb") from error
    seen = figure(character, clip.qpos, name=character.name)
    file = _File(pygltflib)
    bodies = range(1, character.model.nbody)
    world = file.node(name=character.name, rotation=UPRIGHT)
    clock = file.put(clip.time, SCALAR, bounds=True)
    for body in bodies:
        name = character.model.body(body).name or f"body_{body}"
        node = file.node(name=name)
        file.adopt(world, node)
        file.track(node, "translation", clock, seen.position[:, body], VEC3)
        # glTF has xyzw.
        file.track(node, "rotation", clock, seen.rotation[:, body][:, [1, 2, 3, 0]], VEC4)
        for shape in seen.shapes:
            if shape.body == body:
                file.adopt(node, file.shape(shape))
    return file.encoded(world)


class _File:
    """A glTF document that grows; everything in one buffer."""

    def __init__(self, library: Any) -> None:
        self.lib = library
        self.doc = library.GLTF2(asset=library.Asset(version="2.0", generator="physretarget"))
        self.doc.animations = [library.Animation(name="clip", samplers=[], channels=[])]
        self.blob = bytearray()

    def put(self, values: NDArray[Any], kind: str, *, bounds: bool = False) -> int:
        """Append an array to the buffer; the index of its accessor."""
        whole = values.dtype.kind in "iu"
        array = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        view = self.lib.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=array.nbytes)
        self.blob += array.tobytes()
        self.doc.bufferViews.append(view)
        flat = array.reshape(len(array), -1)
        self.doc.accessors.append(
            self.lib.Accessor(
                bufferView=len(self.doc.bufferViews) - 1,
                componentType=UINT if whole else FLOAT,
                count=len(array),
                type=kind,
                min=flat.min(axis=0).tolist() if bounds else None,
                max=flat.max(axis=0).tolist() if bounds else None,
            )
        )
        return len(self.doc.accessors) - 1

    def node(self, **more: Any) -> int:
        """A new node's index."""
        self.doc.nodes.append(self.lib.Node(**more))
        return len(self.doc.nodes) - 1

    def adopt(self, parent: int, child: int) -> None:
        """Hang a node below another."""
        self.doc.nodes[parent].children = [*(self.doc.nodes[parent].children or []), child]

    def track(self, node: int, path: str, clock: int, values: NDArray[Any], kind: str) -> None:
        """Animate a property of a node, linearly between frames."""
        animation = self.doc.animations[0]
        animation.samplers.append(
            self.lib.AnimationSampler(
                input=clock, output=self.put(values, kind), interpolation="LINEAR"
            )
        )
        target = self.lib.AnimationChannelTarget(node=node, path=path)
        channel = self.lib.AnimationChannel(sampler=len(animation.samplers) - 1, target=target)
        animation.channels.append(channel)

    def shape(self, shape: Shape) -> int:
        """A node with one shape's mesh and colour."""
        mesh = _tessellated(shape)
        colour = self.lib.PbrMetallicRoughness(
            baseColorFactor=list(shape.rgba), metallicFactor=0.0, roughnessFactor=1 - shape.gloss
        )
        self.doc.materials.append(self.lib.Material(pbrMetallicRoughness=colour))
        primitive = self.lib.Primitive(
            attributes=self.lib.Attributes(
                POSITION=self.put(mesh.vertices, VEC3, bounds=True),
                NORMAL=self.put(mesh.vertex_normals, VEC3),
            ),
            indices=self.put(mesh.faces.reshape(-1), SCALAR),
            material=len(self.doc.materials) - 1,
        )
        self.doc.meshes.append(self.lib.Mesh(primitives=[primitive]))
        return self.node(
            mesh=len(self.doc.meshes) - 1,
            translation=[float(v) for v in shape.position],
            rotation=[float(v) for v in shape.rotation[[1, 2, 3, 0]]],
        )

    def encoded(self, top: int) -> bytes:
        """The whole as one binary file."""
        self.doc.scenes = [self.lib.Scene(nodes=[top])]
        self.doc.scene = 0
        self.doc.buffers = [self.lib.Buffer(byteLength=len(self.blob))]
        self.doc.set_binary_blob(bytes(self.blob))
        return b"".join(self.doc.save_to_bytes())


def _tessellated(shape: Shape) -> Any:
    if shape.vertices is not None and shape.faces is not None:
        return trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    radius, half = float(shape.size[0]), float(shape.size[1])
    if shape.kind == "box":
        return trimesh.creation.box(2.0 * shape.size)
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(radius, 2.0 * half)
    if shape.kind == "capsule":
        made = trimesh.creation.capsule(2.0 * half, radius)
        made.apply_translation(-made.bounds.mean(axis=0))
        return made
    made = trimesh.creation.icosphere(subdivisions=3)
    made.apply_scale(radius if shape.kind == "sphere" else shape.size)
    return made
