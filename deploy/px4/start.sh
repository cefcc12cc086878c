#!/bin/sh
# Builds and starts PX4 in the loop for Outrider: deploy/px4/start.sh sih | gazebo. Ctrl-C ends it.
set -eu
case "${1:-}" in
sih | gazebo) ;;
*) echo "start.sh: got '${1:-}', expected sih or gazebo" >&2; exit 2 ;;
esac
engine=$(command -v podman || command -v docker) || { echo "start.sh: no container engine; install podman or docker" >&2; exit 2; }
cd "$(dirname "$0")"
"$engine" build -t "outrider-px4-$1" -f "Containerfile.$1" .
exec "$engine" run --rm -it --network host --env-file sitl.env "outrider-px4-$1"
