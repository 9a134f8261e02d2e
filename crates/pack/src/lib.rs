//! The map pack: levels, tile descriptors and features on disk, search, interruptible building.
