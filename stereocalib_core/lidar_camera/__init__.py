"""lidar_camera."""
