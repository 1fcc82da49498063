"""What the help says of sources, exit codes and the first steps."""

SOURCE_HELP = """\
sources (SOURCE is recognised by what is in it):
  .../sequences/06            KITTI odometry sequence; truth from ../../poses/06.txt when there
  .../2011_09_26_drive_0009_sync
                              KITTI raw drive; truth from OXTS, scans from velodyne_points;
                              KITTI-360; single pairs of KITTI stereo 2012, 2015, object
  .../MH_01_easy              EuRoC / ASL recording (mav0/cam0, cam1)
  FOLDER                      left/ right/, cam0/ cam1/, left01.png right01.png ..., and a
                              calibration of any dialect; optional times, poses, scans
  DRIVE.zip                   a zip of any of these
  bag:FILE[?left=TOPIC&right=TOPIC&lidar=TOPIC&truth=TOPIC]
                              ROS 1 or 2 bag, MCAP; topics are found where there is one choice
  synthetic[:NAME][?key=value&...]
                              a rendered drive with known truth: town, curves, straight, plane,
                              e.g. 'synthetic:town?frames=120&fault=truck@40-46'
  video:FILE?camera=camera.yaml[&layout=side-by-side|top-bottom|half-width]
  video:LEFT,RIGHT?camera=camera.yaml, video:0?camera=camera.yaml
                              one video, two videos, or a live camera
  RUN_DIR                     what an earlier `run` wrote (view, compare)
"""

EXIT_CODES = """\
exit codes: 0 fine, 2 bad usage or input, 3 finished but not to be trusted, 130 stopped by Ctrl-C
"""

TOP = f"""\
examples:
  stereocalib demo                              see it work, no data needed
  stereocalib demo --frames 120 --fault truck@40-46
                                                why frames fail, on a drive broken on purpose
  stereocalib run sequences/06 --out run06      numbers for a drive
  stereocalib view sequences/06                 the same, live in a browser
  stereocalib run sequences/07 --out run07 --rig run06/rig.yaml
                                                carry yaw and lever arm over from another drive

{SOURCE_HELP}
{EXIT_CODES}
`stereocalib COMMAND --help` explains one command."""
