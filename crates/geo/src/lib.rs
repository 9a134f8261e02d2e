//! Georeferenced rasters, coordinate systems, tile grids and metres on the ellipsoid.
