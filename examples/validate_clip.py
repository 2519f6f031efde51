"""Judge a clip in ten lines: python examples/validate_clip.py walk.npz lamp.xml"""

import sys

import physretarget as pr

clip, model = sys.argv[1:]
character = pr.Character.load(model)
report = pr.validate(pr.load_clip(clip, character=character), character)
print(report.verdict, report.measures["unexplained_force_rms_bw"].value)
for finding in report.findings[:5]:
    print(finding.severity, finding.code, finding.time_s, finding.message)
sys.exit(not report.passed)
