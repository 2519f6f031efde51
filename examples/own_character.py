"""Key poses of one's own character from suggestions, by script: see docs/characters.md.

python examples/own_character.py robot.urdf walk.bvh
"""

import sys
from pathlib import Path

import physretarget as pr
from physretarget.keyposes.candidates import next_frames
from physretarget.new_character import make_character
from physretarget.studio import Session, Take
from physretarget.studio.rehearsal import Rehearsal

rig, capture = map(Path, sys.argv[1:])
made = make_character(rig, rig.with_name(f"{rig.stem}-character.xml"))
print(*made.notes, sep="\n")
session = Session(
    pr.Character.load(made.path),
    rig.with_suffix(".keyposes.toml"),
    [Take.of(pr.load_capture(capture))],
)
rehearsal = Rehearsal(session)
for _ in range(8):
    frames = next_frames(rehearsal.candidates(), session.keyposes, count=1)
    if not frames:
        break
    motion, frame = rehearsal.candidates().place(frames[0].suggestion.index)
    session.add(0, motion.time[frame], session.revision)
played = rehearsal.play(session.keyposes, 0, "balanced")
print(len(session.keyposes), "key poses;", played.report.verdict if played.report else "no verdict")
