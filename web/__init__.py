"""Everything a browser shows: the Viser scene and panels, and the static page around them."""
