"""A scene as one HTML page: a viewer in plain JavaScript and WebGL 2, and the Gaussians it draws. numpy only."""
