"""Other methods that find grasps, written from their papers."""
