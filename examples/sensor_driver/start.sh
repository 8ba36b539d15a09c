#!/usr/bin/env bash
# The nodes, a recorder and the driver, each a process of its own, until the driver has ended:
# what `ros2 launch isogal_bringup isogal.launch.py vehicle:=real` starts, where ros2 is not
# installed. Run it from the root of the repository.
#
#     examples/sensor_driver/start.sh out/driver [SECONDS PER SECOND]
set -euo pipefail
here=$(dirname "$0")
folder=$1
speed=${2:-1.0}
mkdir -p "$folder/log"
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
parameters=(--ros-args --params-file "$here/vehicle.yaml")
peers='peers:=[gravimeter_node, pmht_mm_node, ukf_fusion_node]'

isogal_recorder "${parameters[@]}" -p "bag:=$folder/bag" 2> "$folder/log/recorder" &
gravimeter_node "${parameters[@]}" -p simulate:=false -p recorders:=1 -p "$peers" \
  2> "$folder/log/gravimeter_node" &
pmht_mm_node "${parameters[@]}" -p recorders:=1 -p "$peers" 2> "$folder/log/pmht_mm_node" &
ukf_fusion_node "${parameters[@]}" -p recorders:=1 -p "$peers" 2> "$folder/log/ukf_fusion_node" &
nodes=$(jobs -p)
trap 'kill -INT $nodes 2> /dev/null; wait' EXIT

until [ "$(cat "$folder"/log/* | grep -c '\]: ready')" -ge 3 ]; do
  for node in $nodes; do # one that cannot start says why
    kill -0 "$node" 2> /dev/null || { cat "$folder"/log/* >&2; exit 1; }
  done
  sleep 0.2
done
python "$here/driver.py" --ros-args -p "folder:=$folder" -p "speed:=$speed"
sleep 2 # for what is under way
