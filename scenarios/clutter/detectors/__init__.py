"""Methods that find grasps in clutter, a file each."""
