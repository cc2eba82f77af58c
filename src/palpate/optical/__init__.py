"""Follow coloured markers in images of a fisheye camera, and learn how they move under force."""
