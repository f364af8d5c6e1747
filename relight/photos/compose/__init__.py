"""The relit picture: shading, maps at the photo's pixels, backgrounds and the shadows on them."""
