"""Objects from mesh files and URDF."""
