"""Facial capture to sparse curves: python examples/face_curves.py take.csv shots out.curves.json"""

import sys

from physretarget.face import Library, Rig, match_take, read_take, write_shot

capture, shots, out = sys.argv[1:]
take = read_take(capture)
library = Library.build([shots])
result = match_take(take, library, Rig.of(take))
for name, channel in result.channels.items():
    print(f"{name}: {len(take.time)} frames → {len(channel.curve.keys)} keys")
print(*write_shot(out, result.shot()), sep="\n")
