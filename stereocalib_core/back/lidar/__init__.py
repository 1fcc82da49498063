"""Do camera and LiDAR still agree over the drive?"""
