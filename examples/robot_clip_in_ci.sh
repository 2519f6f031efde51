#!/usr/bin/env bash
# Judge a folder of robot clips in continuous integration: robot_clip_in_ci.sh MODEL.xml FOLDER FPS
#
# The exit code is that of the verdict: 0 all passed, 1 a clip failed, 2 a clip could not be read.
# clips.sarif is for code scanning, clips.junit.xml for the test report, summary.md for the run's page.
set -uo pipefail
model=$1 clips=$2 fps=$3

judge() {
  physretarget validate "$clips" --model "$model" --fps "$fps" --profile robot --lowpass 6 --quiet "$@"
}

judge --format junit --out clips.junit.xml
status=$?
judge --format sarif --out clips.sarif
judge --format markdown --out summary.md
[ -z "${GITHUB_STEP_SUMMARY:-}" ] || cat summary.md >>"$GITHUB_STEP_SUMMARY"
exit "$status"
