"""Depth images of a table in, pose sets out, and the simulated world in which they are put to use.

The flow::

    station --depth images--> Scene (cloud, grid) --> detector --{task: PoseSet}--> planner
       ^                                                                               |
       +-------- executor <-------- Plan (named segments) <----------------------------+

Frames, in Drake's monogram notation (``X_AB`` is the pose of B in A; adjacent letters cancel):

=====  ==========================================================================================
W      world: the robot's base, z up; the table's top and the workspace's centre at (0.5, 0, 0)
V      corner of the occupancy grid
C      camera: x right, y down, z into the scene (OpenCV)
G      gripper: origin between the pads' centres, z approach, y closing direction
O      object
U      upright: origin at the centre of the base, z towards the rim, x towards the handle (mug: O)
H      handle: origin in the middle of the opening, x away from the body, y through the opening,
       z towards the rim or towards the base
K      hook: origin on the peg's axis, y along the peg towards its tip, z the upward perpendicular
=====  ==========================================================================================

G and G Rot_z(pi) are the same grasp, H and H Rot_x(pi) the same handle; pose sets hold both.

Poses travel between modules as (4, 4) arrays, batches as (N, 4, 4); units are SI.  Importing this
package loads neither Drake nor PyTorch.
"""

import os

# Threads that wait for each other sleep after this many turns of a loop, some 10 microseconds: the
# small products of a detection lose with threads that sleep at once, and a busy machine with such
# that never do.  OpenMP reads it when PyTorch is loaded.
os.environ.setdefault("GOMP_SPINCOUNT", "5000")
