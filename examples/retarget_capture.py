"""A capture becomes a character's clip: python examples/retarget_capture.py walk.bvh out.npz"""

import sys

import physretarget as pr
from physretarget.demo import models_folder

capture, out = sys.argv[1:]
models = models_folder()
lamp = pr.Character.load(models / "lamp.xml")
mapper = pr.learn(lamp, pr.load_keyposes(models / "lamp.keyposes.toml", lamp))
made = pr.retarget(pr.load_capture(capture), mapper)
made.clip.save(out)
print(pr.validate(made.clip, lamp).verdict)
