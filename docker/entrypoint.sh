#!/bin/bash
# Runs a command with ROS 2 and the workspace set up (ROS's own files use unset variables, so no `set -u`).
set -e
source /opt/isogal/install/setup.bash
export PATH="/opt/isogal/install/lib/isogal:$PATH"
exec "$@"
