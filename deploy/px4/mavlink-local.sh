
# Outrider's world: a link of its own with the autopilot's estimate, 100 times a second (outrider sim --pose local).
# PX4 has 19450 -> 19410 for the truth of its own simulator, and one more of each for every further instance.
mavlink start -x -u $((19460+px4_instance)) -r 400000 -m custom -o $((19420+px4_instance))
mavlink stream -r 1 -s HEARTBEAT -u $((19460+px4_instance))
mavlink stream -r 100 -s LOCAL_POSITION_NED -u $((19460+px4_instance))
mavlink stream -r 100 -s ATTITUDE_QUATERNION -u $((19460+px4_instance))
