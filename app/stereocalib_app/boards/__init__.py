"""The page of a camera and a LiDAR before chessboards."""
