#!/bin/bash
# Runs a command with ROS 2 and the workspace set up: that of the image, which is beside this file, that of ISOGAL_INSTALL, or
# the repository's own, built by `colcon build` in ros2_ws (ROS's own files use unset variables, so no `set -u`).
set -e
here=$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")
for install in "${ISOGAL_INSTALL:-$here/install}" "$here/../ros2_ws/install"; do
  [ ! -f "$install/setup.bash" ] || break
done
if [ ! -f "$install/setup.bash" ]; then
  echo "entrypoint.sh: no workspace in ${ISOGAL_INSTALL:-$here/install} nor ros2_ws/install: build it with colcon, or set ISOGAL_INSTALL" >&2
  exit 2
fi
source "$install/setup.bash"
# `colcon build` gives each package a folder of its own, with --merge-install all share one
export PATH="$install/lib/isogal:$install/isogal/lib/isogal:$PATH"
exec "$@"
