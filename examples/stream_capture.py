"""Pose a capture frame by frame, as if it came live: python examples/stream_capture.py walk.bvh"""

import sys
from time import perf_counter

import numpy as np

import physretarget as pr
from physretarget.capture.actor import ActorShape
from physretarget.demo import models_folder

lamp = pr.Character.load(models_folder() / "lamp.xml")
mapper = pr.learn(lamp, pr.load_keyposes(models_folder() / "lamp.keyposes.toml", lamp))
actor = pr.load_capture(sys.argv[1]).on(ActorShape.reference())

streamer, took = pr.Streamer(mapper), []
for time, qpos in zip(actor.time, actor.qpos, strict=True):
    start = perf_counter()
    posed = streamer.next(time, qpos)
    took.append(perf_counter() - start)
    if posed and posed.active.any():
        print(f"{time:6.2f} s  stands on", *np.array(lamp.contacts.names)[posed.active])
print(f"{len(took)} frames, median {1000 * np.median(took):.2f} ms each")
