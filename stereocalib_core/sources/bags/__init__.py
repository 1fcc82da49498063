"""ROS 1 and ROS 2 bags and MCAP files: an index of what is in them, read without loading them."""
