"""People in RGB-D pictures: floor, clusters, pose, identity (Al-Kaff 2019, section 4)."""
