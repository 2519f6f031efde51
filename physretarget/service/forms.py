"""How the API's description tells of multipart forms, which are read by our own reader."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physretarget.options import JOBS

Schema = dict[str, Any]
_FILE: Schema = {"type": "string", "format": "binary"}


def form_body(schema: Schema, encoding: Mapping[str, Any] | None = None) -> Schema:
    """The ``requestBody`` of an operation that takes such a form."""
    content: Schema = {"schema": schema}
    if encoding:
        content["encoding"] = dict(encoding)
    return {"requestBody": {"required": True, "content": {"multipart/form-data": content}}}


def job_form() -> Schema:
    """The form of POST /jobs."""
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {
            "kind": {"type": "string", "enum": list(JOBS), "default": "validate"},
            "options": {
                "type": "string",
                "description": "JSON: the options of the job's kind, by the command line's names.",
                "contentMediaType": "application/json",
                "contentSchema": {"anyOf": [_options(kind) for kind in JOBS]},
                "example": '{"profile": "robot", "lowpass": 6}',
            },
            "clip": {**_FILE, "description": "validate: npz, npy, csv or pkl."},
            "clip_id": {"type": "string", "description": "validate: an uploaded clip."},
            "model": {"type": "string", "description": "validate: lamp, penguin, squirrel, an id."},
            "model_file": {**_FILE, "description": "validate: MJCF, or a zip with its assets."},
            "capture": {**_FILE, "description": "retarget: bvh, amc, c3d, trc or json."},
            "capture_id": {"type": "string", "description": "retarget: an uploaded capture."},
            "skeleton": {**_FILE, "description": "retarget: the ASF file of an AMC capture."},
            "character": {
                "type": "string",
                "description": "retarget: lamp, penguin, squirrel or a registered model's id.",
            },
            "keyposes": {
                "type": "array", "items": _FILE, "maxItems": 16,
                "description": "retarget: key pose files; the built-in characters have their own.",
            },
        },
    }  # fmt: skip


def _options(kind: str) -> Schema:
    properties = {each.name: each.json_schema() for each in JOBS[kind].api}
    return {
        "type": "object", "title": kind, "properties": properties, "additionalProperties": False,
    }  # fmt: skip


def clip_form() -> Schema:
    """The form of POST /clips."""
    return {
        "type": "object",
        "additionalProperties": False,
        "required": ["file"],
        "properties": {"file": {**_FILE, "description": "A clip or a capture."}},
    }


def model_form() -> Schema:
    """The form of POST /models."""
    return {
        "type": "object",
        "additionalProperties": False,
        "required": ["file"],
        "properties": {
            "file": {**_FILE, "description": "MJCF, or a zip with it and its assets."},
            "main": {"type": "string", "description": "The MJCF file's place in the zip."},
            "name": {"type": "string", "description": "What to call it."},
        },
    }
