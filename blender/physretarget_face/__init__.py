# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender add-on: the active object's action, matched against an animator's past shots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

bl_info = {
    "name": "physretarget: an animator's keys",
    "author": "physretarget maintainers",
    "version": (0, 1, 0),
    "blender": (4, 4, 0),
    "location": "Graph Editor or Timeline > Sidebar > physretarget",
    "description": "Dense facial capture becomes an animator's sparse keys",
    "category": "Animation",
}


def animated(context: Any) -> Any:
    """The animation data to match: shape keys first, as faces are made of them."""
    owner = context.object
    if owner is None:
        return None
    shapes = getattr(getattr(owner, "data", None), "shape_keys", None)
    for candidate in (shapes, owner):
        data = getattr(candidate, "animation_data", None)
        if data is not None and data.action is not None:
            return data
    return None


class PHYSRETARGET_OT_match(bpy.types.Operator):
    """Match the action against a library of past shots; the result is a new action"""

    bl_idname = "action.physretarget_match"
    bl_label = "Match Action"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    library: StringProperty(  # type: ignore[valid-type]
        name="Library", subtype="FILE_PATH", description="A library file or a folder of shots"
    )
    method: EnumProperty(  # type: ignore[valid-type]
        name="Method",
        items=[
            ("distance", "Distance", "Sum of squared differences"),
            ("sax", "SAX", "Symbolic words; fast, coarse"),
            ("hmm", "HMM", "Viterbi alignment; bends time"),
        ],
    )
    fidelity: FloatProperty(  # type: ignore[valid-type]
        name="Fidelity", default=0.01, min=0.001, max=0.5, precision=3,
        description="Deviation, of what a channel moves, worth one unit of price",
    )  # fmt: skip
    key_cost: FloatProperty(  # type: ignore[valid-type]
        name="Key cost", default=12.0, min=0.1, max=200.0, description="Higher gives fewer keys"
    )
    lips: BoolProperty(name="Lips too", default=False)  # type: ignore[valid-type]
    preview_range: BoolProperty(  # type: ignore[valid-type]
        name="Preview range only", default=False,
        description="Match only the scene's preview range; keys outside it stay",
    )  # fmt: skip
    keep_selected: BoolProperty(  # type: ignore[valid-type]
        name="Keep selected keys", default=False,
        description="Selected keyframes are locked: they stay exactly as they are",
    )  # fmt: skip

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Something must be animated."""
        return animated(context) is not None

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Ask for the settings first."""
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: Any) -> set[str]:
        """Match and assign the new action."""
        try:
            from physretarget.errors import PhysretargetError
        except ImportError:
            self.report({"ERROR"}, "physretarget is not installed in Blender's Python: see README")
            return {"CANCELLED"}
        try:
            made, before, after, copied = self._match(context)
        except PhysretargetError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{made.name}: {after} keys of {before}; {copied} curves copied")
        return {"FINISHED"}

    def _match(self, context: Any) -> tuple[Any, int, int, int]:
        from physretarget.errors import InputError
        from physretarget.face.library import Library
        from physretarget.face.match import MatchSettings, match
        from physretarget.face.rig import Rig

        from . import curves

        data = animated(context)
        bag = curves.channelbag(data.action, data.action_slot)
        named = curves.names_of(bag.fcurves) if bag is not None else {}
        named = {name: f for name, f in named.items() if not f.is_empty}
        if not named:
            raise InputError("the action has no curves.")
        place = Path(bpy.path.abspath(self.library))
        if not self.library or not place.exists():
            raise InputError(f"the library {self.library or '(none chosen)'} does not exist.")
        library = Library.build([place]) if place.is_dir() else Library.load(place)
        scene = context.scene.render
        fps, start = scene.fps / scene.fps_base, curves.first_frame(named)
        take = curves.take_of(data.action.name, named, fps)
        settings = MatchSettings(
            method=self.method, fidelity=self.fidelity, key_cost=self.key_cost, lips=self.lips
        )
        rig = Rig.of(take)
        span = None
        if self.preview_range:
            first, last = context.scene.frame_preview_start, context.scene.frame_preview_end
            ends = np.clip((np.array([first, last]) - start) / fps, 0.0, take.time[-1])
            span = (float(ends[0]), float(ends[1]))
        locked = {}
        if self.keep_selected:
            asked = {c.name for c in rig.matched(lips=self.lips)}
            locked = {
                name: keys
                for name, curve in named.items()
                if name in asked and (keys := curves.selected(curve, fps, start, span))
            }
        result = match(take, library, rig, settings, span=span, locked=locked)
        return _assign(data, named, result, fps, start, span)


def _assign(
    data: Any,
    named: dict[str, Any],
    result: Any,
    fps: float,
    start: int,
    span: tuple[float, float] | None,
) -> tuple[Any, int, int, int]:
    """A new action with the matched curves, and copies of the others."""
    from . import curves

    old = data.action
    # A copy, emptied: slot, name and user flags stay as the animator had them.
    made = old.copy()
    made.name = f"{old.name} matched"
    old.use_fake_user = True
    slot = next(s for s in made.slots if s.identifier == data.action_slot.identifier)
    bag = curves.channelbag(made, slot, make=True)
    before = sum(len(f.keyframe_points) for f in named.values())
    after = copied = 0
    for name, source in named.items():
        target = bag.fcurves.find(source.data_path, index=source.array_index)
        channel = result.channels.get(name)
        if channel is None:
            copied += 1
        else:
            curves.clear(target, fps, start, span)
            curves.write(target, channel.curve, fps, start)
        after += len(target.keyframe_points)
    data.action = made
    data.action_slot = slot
    return made, before, after, copied


class PHYSRETARGET_PT_panel(bpy.types.Panel):
    """Sidebar"""

    bl_label = "physretarget"
    bl_space_type = "GRAPH_EDITOR"
    bl_region_type = "UI"
    bl_category = "physretarget"

    def draw(self, context: Any) -> None:
        """One button; its dialog asks for the rest."""
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator(PHYSRETARGET_OT_match.bl_idname, icon="GRAPH")


class PHYSRETARGET_PT_dopesheet(PHYSRETARGET_PT_panel):
    """The same in the timeline and dope sheet"""

    bl_space_type = "DOPESHEET_EDITOR"


_CLASSES = (PHYSRETARGET_OT_match, PHYSRETARGET_PT_panel, PHYSRETARGET_PT_dopesheet)


def register() -> None:
    """Called by Blender."""
    for each in _CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """Called by Blender."""
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
